//! A real archive, a real server on a free port, and a client that sends exactly the bytes it is told.
#![allow(dead_code, reason = "each test program uses a part of this")]

pub(crate) mod store;

use std::{collections::BTreeMap, future::Future, net::SocketAddr, path::Path, time::Duration};

use half::f16;
use tileserver::{Collection, Options, Site};
use tileset::{
    Archive, ArchiveWriter, Codec, Column, Direction, Factorization, Ledger, Manifest, Page, PageId, Tile,
    codec::{MipImage, encode_column, encode_page},
};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{TcpListener, TcpStream},
    sync::oneshot,
    task::JoinHandle,
};

/// A manifest of two groups; `seed` makes a difference.
pub(crate) fn manifest(width: u32, height: u32, seed: u32) -> Manifest {
    let direction = |i: u32| Direction {
        theta: 0.1 * f64::from(i),
        phi: f64::from(i),
    };
    Manifest {
        name: format!("test {seed}"),
        generator: "test".into(),
        width,
        height,
        wrap: true,
        cosine: false,
        views: (0..3).map(direction).collect(),
        lights: (0..2).map(direction).collect(),
        components: 6,
        factorization: Factorization::Fmf,
        codec: Codec::DctDeltaZstd { step: 0.01 },
        texture_scale: 1.0,
        mean_rgb: [0.5; 3],
        singular_values: vec![0.1; 6],
        errors: Ledger::default(),
    }
}

/// An archive of 150×100 texels: group 0 varies, group 1 is the same everywhere, so that only its root is stored.
pub(crate) fn archive(seed: u32) -> Vec<u8> {
    let manifest = manifest(150, 100, seed);
    let pyramid = manifest.pyramid().unwrap();
    let mut writer = ArchiveWriter::new(manifest.clone()).unwrap();
    for group in 0..2 {
        let texel = |at: u32| {
            if group == 0 {
                ((at * (seed + 7)) % 101) as f32 / 101.0
            } else {
                0.25
            }
        };
        let texels = (0..150 * 100)
            .map(|at| [texel(at), texel(at + 1), texel(at / 150), texel(at / 7)])
            .collect();
        let mut mips = vec![MipImage {
            width: 150,
            height: 100,
            texels,
        }];
        for _ in 0..pyramid.tail_mip() {
            mips.push(mips.last().unwrap().downsample());
        }
        let mut decoded: BTreeMap<Tile, Page> = BTreeMap::new();
        for tile in pyramid.tiles() {
            let parent = pyramid.parent(tile).map(|parent| &decoded[&parent]);
            let page = encode_page(
                manifest.codec,
                &pyramid,
                tile,
                &mips[usize::from(tile.mip)],
                parent,
            )
            .unwrap();
            writer
                .add_page(PageId { group, tile }, page.bytes, page.weight)
                .unwrap();
            decoded.insert(tile, page.decoded);
        }
        let value = |i: usize| f16::from_f32(((i * 31 + seed as usize) % 17) as f32 / 17.0);
        let texels = (0..manifest.column_texels())
            .map(|i| [0, 1, 2, 3].map(|c| value(4 * i + c)))
            .collect();
        writer
            .add_column(group, encode_column(&Column { texels }).unwrap(), 1.0)
            .unwrap();
    }
    let mut bytes = Vec::new();
    writer.write(&mut bytes).unwrap();
    bytes
}

/// An archive with a column of `bytes` bytes of noise, for answers that take a while.
pub(crate) fn large_archive(bytes: usize) -> Vec<u8> {
    let manifest = manifest(8, 8, 0);
    let root = manifest.pyramid().unwrap().root();
    let mut writer = ArchiveWriter::new(manifest).unwrap();
    let mut state = 1u64;
    for group in 0..2 {
        let noise = (0..bytes).map(|_| {
            state = state.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(1);
            (state >> 56) as u8
        });
        writer.add_column(group, noise.collect(), 1.0).unwrap();
        writer
            .add_page(PageId { group, tile: root }, Vec::new(), 0.0)
            .unwrap();
    }
    let mut archive = Vec::new();
    writer.write(&mut archive).unwrap();
    archive
}

/// Opens an archive in memory.
pub(crate) fn open(bytes: Vec<u8>) -> Archive<Vec<u8>> {
    Archive::open(bytes).unwrap()
}

/// Content id as in addresses.
pub(crate) fn id(archive: &[u8]) -> String {
    format!("{:032x}", open(archive.to_vec()).index.id)
}

/// Puts a file in the place of another at once.
pub(crate) fn replace(path: &Path, bytes: &[u8]) {
    let new = path.with_extension("new");
    std::fs::write(&new, bytes).unwrap();
    std::fs::rename(new, path).unwrap();
}

/// A running server.
pub(crate) struct Server {
    pub(crate) address: SocketAddr,
    stop: oneshot::Sender<()>,
    running: JoinHandle<tileserver::Result<()>>,
}

impl Server {
    pub(crate) async fn start(folder: &Path) -> Self {
        // Changes of the folder are seen at once.
        let options = Options {
            list_age: Duration::ZERO,
            ..Options::default()
        };
        Self::with(folder, options).await
    }

    pub(crate) async fn with(folder: &Path, options: Options) -> Self {
        Self::of(Collection::open(folder).unwrap(), options).await
    }

    pub(crate) async fn of(site: impl Into<Site>, options: Options) -> Self {
        let site = site.into();
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let (stop, stopped) = oneshot::channel();
        let running = tokio::spawn(tileserver::run(listener, site, options, async {
            _ = stopped.await
        }));
        Self {
            address,
            stop,
            running,
        }
    }

    /// Tells the server to stop; the result ends when it has.
    pub(crate) fn stop(self) -> impl Future<Output = ()> {
        let _ = self.stop.send(());
        async { self.running.await.unwrap().unwrap() }
    }

    pub(crate) async fn connect(&self) -> TcpStream {
        TcpStream::connect(self.address).await.unwrap()
    }

    /// Sends a request for a target as it stands, and reads the whole answer.
    pub(crate) async fn request(&self, method: &str, target: &str, fields: &[(&str, &str)]) -> Response {
        let mut stream = self.connect().await;
        send(&mut stream, method, target, fields).await;
        receive(stream).await
    }

    pub(crate) async fn get(&self, target: &str) -> Response {
        self.request("GET", target, &[]).await
    }
}

pub(crate) async fn send(stream: &mut TcpStream, method: &str, target: &str, fields: &[(&str, &str)]) {
    let mut head = format!("{method} {target} HTTP/1.1\r\nhost: test\r\nconnection: close\r\n");
    for (name, value) in fields {
        head.push_str(&format!("{name}: {value}\r\n"));
    }
    head.push_str("\r\n");
    stream.write_all(head.as_bytes()).await.unwrap();
}

pub(crate) async fn receive(mut stream: TcpStream) -> Response {
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).await.unwrap();
    Response::parse(&bytes)
}

/// An answer.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Response {
    pub(crate) status: u16,
    /// Names in lower case.
    pub(crate) fields: BTreeMap<String, String>,
    pub(crate) body: Vec<u8>,
}

impl Response {
    fn parse(bytes: &[u8]) -> Self {
        let end = bytes
            .windows(4)
            .position(|window| window == b"\r\n\r\n")
            .expect("a head");
        let head = std::str::from_utf8(&bytes[..end]).unwrap();
        let (status, fields) = head.split_once("\r\n").unwrap();
        let fields = fields.lines().map(|line| line.split_once(": ").unwrap());
        Self {
            status: status.split(' ').nth(1).unwrap().parse().unwrap(),
            fields: fields
                .map(|(name, value)| (name.to_lowercase(), value.to_owned()))
                .collect(),
            body: bytes[end + 4..].to_vec(),
        }
    }

    #[track_caller]
    pub(crate) fn field(&self, name: &str) -> &str {
        self.fields
            .get(name)
            .map_or_else(|| panic!("no {name} in {self:?}"), String::as_str)
    }

    #[track_caller]
    pub(crate) fn json(&self) -> serde_json::Value {
        assert_eq!(self.field("content-type"), "application/json");
        serde_json::from_slice(&self.body).unwrap()
    }

    /// Checks that this is an error with this status, and returns its detail.
    #[track_caller]
    pub(crate) fn error(&self, status: u16, error: &str) -> String {
        assert_eq!(self.status, status, "{self:?}");
        assert_eq!(self.field("cache-control"), "no-store");
        let json = self.json();
        assert_eq!(json["error"], error);
        json["detail"].as_str().unwrap().to_owned()
    }
}
