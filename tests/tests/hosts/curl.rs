//! curl asks our server: what it takes for ranges, conditions and HTTP/2 is what the rest of the world takes for them.

use std::process::Command;

use tests::Server;

use crate::FIXTURE;

/// What curl was answered.
struct Answered {
    /// Status and version of HTTP, such as `206 1.1`.
    status: String,
    head: String,
    body: Vec<u8>,
}

impl Answered {
    #[track_caller]
    fn field(&self, name: &str) -> &str {
        let fields = self.head.lines().filter_map(|line| line.split_once(": "));
        let mut found = fields.filter(|(field, _)| field.eq_ignore_ascii_case(name));
        let (_, value) = found
            .next()
            .unwrap_or_else(|| panic!("no {name} in {}", self.head));
        value.trim()
    }
}

fn curl(url: &str, arguments: &[&str]) -> Answered {
    let folder = tempfile::tempdir().unwrap();
    let (head, body) = (folder.path().join("head"), folder.path().join("body"));
    let output = Command::new("curl")
        .args(["--silent", "--show-error", "--max-time", "30", "--noproxy", "*"])
        .args(["--write-out", "%{http_code} %{http_version}"])
        .args(arguments)
        .args([
            "--dump-header".as_ref(),
            head.as_os_str(),
            "--output".as_ref(),
            body.as_os_str(),
        ])
        .arg(url)
        .output()
        .expect("install curl: cargo xtask setup");
    assert!(
        output.status.success(),
        "{url}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    Answered {
        status: String::from_utf8(output.stdout).unwrap(),
        head: std::fs::read_to_string(head).unwrap(),
        body: std::fs::read(body).unwrap_or_default(), // curl makes no file for an answer without a body.
    }
}

#[test]
fn curl_gets_ranges_conditions_and_both_versions_of_http() {
    let server = Server::start(&FIXTURE.tiles());
    let name = &FIXTURE.names()[0];
    let url = format!("{}/v1/{name}.bsvtf", server.address);
    let file = std::fs::read(FIXTURE.archive(name)).unwrap();
    let length = file.len();

    let whole = curl(&url, &[]);
    assert_eq!((whole.status.as_str(), &whole.body), ("200 1.1", &file));
    let etag = whole.field("etag").to_owned();
    let head = curl(&url, &["--head"]);
    assert_eq!(
        (head.status.as_str(), head.field("content-length")),
        ("200 1.1", &*length.to_string())
    );
    assert_eq!(head.field("etag"), etag);

    let part = curl(&url, &["--range", "100-299"]);
    assert_eq!(
        (part.status.as_str(), &part.body[..]),
        ("206 1.1", &file[100..300])
    );
    assert_eq!(part.field("content-range"), format!("bytes 100-299/{length}"));
    let tail = curl(&url, &["--range", "-64"]);
    assert_eq!(tail.body, file[length - 64..]);
    let parts = curl(&url, &["--range", "0-9,500-519"]);
    assert!(
        parts
            .field("content-type")
            .starts_with("multipart/byteranges; boundary=")
    );
    assert!(parts.body.windows(20).any(|window| window == &file[500..520]));
    let beyond = curl(&url, &["--range", &format!("{length}-")]);
    assert_eq!(
        (beyond.status.as_str(), beyond.field("content-range")),
        ("416 1.1", &*format!("bytes */{length}"))
    );

    // A download that was broken off goes on, but only with the same content.
    let same = curl(
        &url,
        &["--range", "100-", "--header", &format!("if-range: {etag}")],
    );
    assert_eq!((same.status.as_str(), &same.body[..]), ("206 1.1", &file[100..]));
    let other = curl(&url, &["--range", "100-", "--header", "if-range: \"other\""]);
    assert_eq!((other.status.as_str(), &other.body), ("200 1.1", &file));

    let known = curl(&url, &["--header", &format!("if-none-match: \"x\", {etag}")]);
    assert_eq!((known.status.as_str(), known.body.len()), ("304 1.1", 0));
    let unmet = curl(&url, &["--header", "if-match: \"other\""]);
    assert_eq!(unmet.status, "412 1.1");

    let second = curl(&url, &["--http2-prior-knowledge", "--range", "0-99"]);
    assert_eq!(
        (second.status.as_str(), &second.body[..]),
        ("206 2", &file[..100])
    );
    let upgraded = curl(&url, &["--http2"]);
    assert_eq!(
        (upgraded.status.as_str(), &upgraded.body),
        ("200 1.1", &file),
        "an upgrade may be passed over"
    );

    let catalogue = curl(&format!("{}/v1/", server.address), &["--compressed"]);
    assert_eq!(catalogue.field("content-encoding"), "gzip");
    assert!(String::from_utf8(catalogue.body).unwrap().contains(name));
}
