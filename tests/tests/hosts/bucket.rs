//! A store that speaks S3: as a host by itself, and behind our server.

use std::path::Path;

use engine::stream::open_with;
use hyper::server::conn::http1;
use hyper_util::rt::TokioIo;
use s3s::{
    S3Result,
    access::{S3Access, S3AccessContext},
    auth::SimpleAuth,
    service::S3ServiceBuilder,
};
use s3s_fs::FileSystem;
use tests::Server;
use tileserver::{Collection, Objects, Options};
use tokio::{net::TcpListener, runtime::Runtime};

use crate::{FIXTURE, check, options};

const KEY: &str = "key";
const SECRET: &str = "secret";

/// Who signs must sign right; who does not is let in as well, as where a bucket is public.
struct Public;

#[async_trait::async_trait]
impl S3Access for Public {
    async fn check(&self, _: &mut S3AccessContext<'_>) -> S3Result<()> {
        Ok(())
    }
}

/// Buckets are the folders of a folder, until it is dropped.
struct Buckets {
    address: String,
    _runtime: Runtime,
}

impl Buckets {
    fn start(folder: &Path) -> Self {
        let runtime = Runtime::new().unwrap();
        let mut service = S3ServiceBuilder::new(FileSystem::new(folder).unwrap());
        service.set_auth(SimpleAuth::from_single(KEY, SECRET));
        service.set_access(Public);
        let service = service.build();
        let listener = runtime.block_on(TcpListener::bind("127.0.0.1:0")).unwrap();
        let address = format!("http://{}", listener.local_addr().unwrap());
        runtime.spawn(async move {
            while let Ok((stream, _)) = listener.accept().await {
                let connection =
                    http1::Builder::new().serve_connection(TokioIo::new(stream), service.clone());
                tokio::spawn(connection);
            }
        });
        Self {
            address,
            _runtime: runtime,
        }
    }
}

/// The archives in a bucket.
fn buckets() -> (tempfile::TempDir, Buckets) {
    let (site, folder) = (FIXTURE.site(), tempfile::tempdir().unwrap());
    std::fs::create_dir(folder.path().join("materials")).unwrap();
    std::fs::rename(site.path(), folder.path().join("materials/btf")).unwrap();
    let buckets = Buckets::start(folder.path());
    (folder, buckets)
}

#[test]
fn a_bucket_is_enough() {
    let (_folder, buckets) = buckets();
    let name = &FIXTURE.names()[0];
    for url in [
        format!("{}/materials/btf", buckets.address),
        format!("{}/materials/btf/{name}.bsvtf", buckets.address),
    ] {
        let mut source = open_with(&url, &options(None)).unwrap();
        for name in FIXTURE.names() {
            check(&mut *source, name, || {});
        }
    }
}

#[test]
fn our_server_stands_in_front_of_a_bucket() {
    let (folder, buckets) = buckets();
    let settings = |secret: &str| {
        [
            ("aws_endpoint", buckets.address.as_str()),
            ("aws_allow_http", "true"),
            ("aws_region", "us-east-1"),
            ("aws_access_key_id", KEY),
            ("aws_secret_access_key", secret),
        ]
        .map(|(name, value)| (name.to_owned(), value.to_owned()))
    };
    let open = |secret: &str| {
        let store = Objects::with_settings("s3://materials/btf", settings(secret)).unwrap();
        let runtime = Runtime::new().unwrap();
        runtime.block_on(Collection::of(std::sync::Arc::new(store), "the bucket"))
    };
    let refused = open("another").err().expect("signatures are checked").to_string();
    assert!(
        refused.contains("the bucket") && refused.contains("SignatureDoesNotMatch"),
        "{refused}"
    );
    let server = Server::of(open(SECRET).unwrap(), Options::default());
    let mut source = open_with(&server.address, &options(None)).unwrap();
    let names = FIXTURE.names();
    check(&mut *source, names[0], || {});
    // What has gone from the bucket is named in the error; the other archive goes on.
    let mut left = open_with(&server.address, &options(None)).unwrap();
    std::fs::remove_file(folder.path().join(format!("materials/btf/{}.bsvtf", names[0]))).unwrap();
    check(&mut *left, names[1], || {});
}

/// Google's stores are asked as their XML interface says, which for listing and reading is that of S3 without its signatures:
/// here with a key that stands for a program of Google's that hands out tokens without asking, as its emulators do.
#[test]
fn a_bucket_of_google_is_read_by_its_own_interface() {
    const ACCOUNT: &str =
        r#"{"private_key": "none", "private_key_id": "none", "client_email": "none", "disable_oauth": true}"#;
    let (_folder, buckets) = buckets();
    let open = |url: &str| {
        let settings = [
            ("google_base_url", buckets.address.as_str()),
            ("google_service_account_key", ACCOUNT),
            ("allow_http", "true"),
        ];
        let settings = settings.map(|(name, value)| (name.to_owned(), value.to_owned()));
        let store = Objects::with_settings(url, settings).unwrap();
        let runtime = Runtime::new().unwrap();
        runtime.block_on(Collection::of(std::sync::Arc::new(store), "the bucket"))
    };
    let server = Server::of(open("gs://materials/btf").unwrap(), Options::default());
    let mut source = open_with(&server.address, &options(None)).unwrap();
    for name in FIXTURE.names() {
        check(&mut *source, name, || {});
    }
    let missing = open("gs://no-such-bucket/btf")
        .err()
        .expect("it is not there")
        .to_string();
    assert!(missing.contains("the bucket"), "{missing}");
}
