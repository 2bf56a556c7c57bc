//! An archive that is damaged on the server: its records are refused by name, the other material goes on.

use engine::{Error, stream::open_with};
use tests::{Server, ask, requests, soon};
use tileset::Archive;

use crate::{FIXTURE, NAMES};

#[test]
fn damaged_records_are_named_and_all_others_come() {
    let (site, [bad, good]) = (FIXTURE.site(), NAMES);
    let path = site.path().join(format!("{bad}.bsvtf"));
    let mut bytes = std::fs::read(&path).unwrap();
    let index = Archive::open(bytes.clone()).unwrap().index;
    let column = index.column(1).unwrap();
    bytes[column.offset as usize + 3] ^= 0x10;
    std::fs::write(&path, bytes).unwrap();

    let server = Server::start(site.path());
    let mut source = open_with(&server.address, &soon()).unwrap();
    let mut refused = Vec::new();
    for name in [bad, good] {
        ask(
            &mut *source,
            &requests(name, &FIXTURE.archive(name)),
            |_, answer, stored| match answer.bytes {
                Ok(bytes) => assert_eq!(bytes, stored, "{}", answer.request),
                Err(error) => refused.push(error),
            },
        );
    }
    let [error] = &refused[..] else {
        panic!("{refused:?}")
    };
    let text = error.to_string();
    assert!(text.contains(bad) && text.contains("column"), "{text}");
}

#[test]
fn an_archive_that_is_none_is_named_and_the_other_is_served() {
    let (site, [bad, good]) = (FIXTURE.site(), NAMES);
    let path = site.path().join(format!("{bad}.bsvtf"));
    let bytes = std::fs::read(&path).unwrap();
    // Damage in the manifest, and half of a copy.
    let mut damaged = bytes.clone();
    damaged[100] ^= 1;
    for bytes in [damaged, bytes[..bytes.len() / 2].to_vec()] {
        std::fs::write(&path, bytes).unwrap();
        let server = Server::start(site.path());
        let mut source = open_with(&server.address, &soon()).unwrap();
        let index = &requests(bad, &FIXTURE.archive(bad))[..1];
        ask(&mut *source, index, |_, answer, _| {
            let error = answer.bytes.unwrap_err();
            assert!(!matches!(error, Error::NotFound(_)), "it is there: {error}");
            assert!(error.to_string().contains(bad), "{error}");
        });
        ask(
            &mut *source,
            &requests(good, &FIXTURE.archive(good)),
            |_, answer, stored| {
                assert_eq!(answer.bytes.unwrap(), stored, "{}", answer.request);
            },
        );
    }
}
