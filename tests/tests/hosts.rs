//! Archives on hosts that know nothing of them: nginx, and a store that speaks S3. Both must be installed (Debian: `nginx`; `pip install
//! 'moto[server]'`).

use std::{
    io::Read,
    net::TcpListener,
    path::Path,
    process::{Child, Command, Stdio},
    sync::{Arc, LazyLock},
    time::{Duration, Instant},
};

use engine::stream::{Answer, DiskCacheOptions, OpenOptions, Request, RetryOptions, TileSource, open_with};
use tests::Fixture;
use tileset::{Archive, PageId};

static FIXTURE: LazyLock<Fixture> = LazyLock::new(Fixture::new);

/// A program, until it is dropped.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn free_port() -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    listener.local_addr().unwrap().port()
}

fn start(command: &mut Command, port: u16, install: &str) -> Running {
    let command = command.stdout(Stdio::null()).stderr(Stdio::null());
    let running = Running(
        command
            .spawn()
            .unwrap_or_else(|error| panic!("{install}: {error}")),
    );
    let begin = Instant::now();
    while std::net::TcpStream::connect(("127.0.0.1", port)).is_err() {
        assert!(
            begin.elapsed() < Duration::from_secs(60),
            "{install}: it does not listen"
        );
        std::thread::sleep(Duration::from_millis(5));
    }
    running
}

/// nginx over a folder, without anything set for our files. It runs in this process' rights, in one process.
fn nginx(folder: &Path, port: u16) -> Running {
    let own = folder.join("nginx");
    std::fs::create_dir_all(&own).unwrap();
    let (root, at) = (folder.display(), own.display());
    let temporary = ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"]
        .map(|name| format!("{name}_temp_path {at}/{name};"))
        .join(" ");
    let configuration = format!(
        "daemon off; master_process off; pid {at}/pid; error_log {at}/errors; events {{}}
         http {{ access_log off; {temporary} server {{ listen 127.0.0.1:{port}; root {root}; }} }}"
    );
    std::fs::write(own.join("conf"), configuration).unwrap();
    let mut command = Command::new("nginx");
    start(command.arg("-c").arg(own.join("conf")), port, "install nginx")
}

fn options(cache: Option<&Path>) -> OpenOptions {
    OpenOptions {
        retry: RetryOptions {
            backoff: Duration::from_millis(20),
            ..RetryOptions::default()
        },
        disk: cache.map(|folder| DiskCacheOptions {
            folder: folder.to_owned(),
            budget_bytes: 1 << 30,
        }),
        ..OpenOptions::default()
    }
}

/// Everything that can be asked of an archive, as it stands in its file.
fn requests(name: &str) -> Vec<(Request, Vec<u8>)> {
    let file = std::fs::File::open(FIXTURE.archive(name)).unwrap();
    let stored = Archive::open(file).unwrap();
    let archive: Arc<str> = name.into();
    let index = Request::Index {
        archive: archive.clone(),
    };
    let mut all = vec![(index, stored.prefix().unwrap())];
    for group in 0..stored.index.manifest.groups() as u16 {
        let column = Request::Column {
            archive: archive.clone(),
            group,
        };
        all.push((column, stored.read_column(group).unwrap()));
        for tile in stored.index.pyramid.tiles() {
            let page = PageId { group, tile };
            let request = Request::Page {
                archive: archive.clone(),
                page,
            };
            all.push((request, stored.read_page(page).unwrap()));
        }
    }
    all
}

/// Asks for all, the index first, and compares; `between` is called when half of it has come.
fn check(source: &mut dyn TileSource, name: &str, mut between: impl FnMut()) -> Vec<Answer> {
    let all = requests(name);
    let mut answers = Vec::new();
    let mut left: Vec<_> = all.iter().rev().collect();
    let begin = Instant::now();
    while answers.len() < all.len() {
        assert!(
            begin.elapsed() < Duration::from_secs(60),
            "{} of {}",
            answers.len(),
            all.len()
        );
        while (!answers.is_empty() || source.in_flight() == 0) && source.in_flight() < source.capacity() {
            let Some((request, _)) = left.pop() else { break };
            source.submit(request.clone()).unwrap();
        }
        match source.poll() {
            Some(answer) => {
                let bytes = answer.bytes.as_ref().unwrap_or_else(|error| panic!("{error}"));
                let (_, expected) = all
                    .iter()
                    .find(|(request, _)| *request == answer.request)
                    .unwrap();
                assert_eq!(bytes, expected, "{}", answer.request);
                answers.push(answer);
                if answers.len() == all.len() / 2 {
                    between();
                }
            }
            None => source.wait(Duration::from_millis(50)),
        }
    }
    answers
}

fn names() -> Vec<String> {
    let files = std::fs::read_dir(FIXTURE.tiles()).unwrap();
    let names = files.filter_map(|file| {
        let name = file.unwrap().file_name().into_string().unwrap();
        Some(name.strip_suffix(".bsvtf")?.to_owned())
    });
    names.collect()
}

/// The fixture's archives in a folder of the test's own.
fn site() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in names() {
        let to = folder.path().join(format!("{name}.bsvtf"));
        std::fs::copy(FIXTURE.archive(&name), to).unwrap();
    }
    folder
}

#[test]
fn nginx_is_enough_even_if_it_is_started_again_and_the_cache_even_without_it() {
    let (site, cache, port) = (site(), tempfile::tempdir().unwrap(), free_port());
    let url = format!("http://127.0.0.1:{port}/");
    let mut host = Some(nginx(site.path(), port));
    let with_cache = options(Some(cache.path()));
    let mut source = open_with(&url, &with_cache).unwrap();
    for name in names() {
        check(&mut *source, &name, || {
            host.take();
            host = Some(nginx(site.path(), port));
        });
    }
    let stats = source.stats();
    assert!(
        stats.exchanges < stats.requested || stats.from_ram > 0,
        "{stats:?}"
    );

    // Another run: nothing but the indices crosses the wire. And one without the host.
    let mut source = open_with(&url, &with_cache).unwrap();
    for name in names() {
        check(&mut *source, &name, || {});
    }
    assert_eq!(source.stats().offline, 0);
    assert!(source.stats().from_disk > 0, "{:?}", source.stats());
    host.take();
    let mut source = open_with(&url, &with_cache).unwrap();
    for name in names() {
        let answers = check(&mut *source, &name, || {});
        assert!(answers.iter().all(|answer| answer.wire_bytes == 0));
    }
    assert_eq!(source.stats().offline as usize, names().len());
}

#[test]
fn a_bucket_is_enough() {
    let (site, port) = (site(), free_port());
    let mut command = Command::new("moto_server");
    let ports = port.to_string();
    let _host = start(command.args(["-p", &ports]), port, "pip install 'moto[server]'");
    put(port, "/materials", &[]);
    for name in names() {
        let bytes = std::fs::read(site.path().join(format!("{name}.bsvtf"))).unwrap();
        put(port, &format!("/materials/btf/{name}.bsvtf"), &bytes);
    }
    let name = &names()[0];
    for url in [
        format!("http://127.0.0.1:{port}/materials/btf"),
        format!("http://127.0.0.1:{port}/materials/btf/{name}.bsvtf"),
    ] {
        let mut source = open_with(&url, &options(None)).unwrap();
        for name in names() {
            check(&mut *source, &name, || {});
        }
    }
}

/// PUT, as anybody may in a store that is made for tests.
fn put(port: u16, path: &str, bytes: &[u8]) {
    use std::io::Write;
    let mut stream = std::net::TcpStream::connect(("127.0.0.1", port)).unwrap();
    let head = format!(
        "PUT {path} HTTP/1.1\r\nhost: 127.0.0.1:{port}\r\nconnection: close\r\nx-amz-acl: public-read\r\n\
         content-length: {}\r\n\r\n",
        bytes.len()
    );
    stream.write_all(&[head.as_bytes(), bytes].concat()).unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    assert!(answer.contains(" 200 "), "{answer}");
}
