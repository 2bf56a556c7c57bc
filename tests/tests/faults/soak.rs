//! Some seconds of everything at once against a server in a process of its own: random requests that are given up at random, archives that
//! are replaced, clients that break the rules. What comes is right, and memory does not grow.

use std::{
    io::{Read, Write},
    net::TcpStream,
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

use engine::stream::{Request, open_with};
use tests::{PATIENCE, ServerProcess, ask, requests, soon};

use crate::{FIXTURE, NAMES};

/// Until caches are full and threads are there.
const WARM_UP: Duration = Duration::from_secs(2);
/// From then on, unless [`SECONDS`] says how long.
const SOAK: Duration = Duration::from_secs(4);
/// A variable of the environment, for those who want to soak for an hour.
const SECONDS: &str = "EIGENTILE_SOAK_SECONDS";
/// What allocators may do in that time.
const MAX_GROWTH_BYTES: u64 = 8 << 20;

/// Numbers that are the same in every run (Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014: SplitMix64).
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((bits ^ (bits >> 31)) % end as u64) as usize
    }
}

/// Asks for records in any order and gives up some of them; how many have come.
fn client(address: &str, seed: u64, end: &AtomicBool) -> u64 {
    let all: Vec<_> = NAMES
        .iter()
        .flat_map(|name| requests(name, &FIXTURE.archive(name)))
        .collect();
    let (mut random, mut came) = (Random(seed), 0);
    while !end.load(Ordering::Relaxed) {
        let mut source = open_with(address, &soon()).unwrap();
        let mut open = Vec::new();
        for _ in 0..400 {
            match random.below(8) {
                0..4 => {
                    let (request, _) = &all[random.below(all.len())];
                    open.extend(source.submit(request.clone()));
                }
                4 if !open.is_empty() => source.cancel(open.swap_remove(random.below(open.len()))),
                _ => source.wait(Duration::from_millis(1)),
            }
            while let Some(answer) = source.poll() {
                open.retain(|ticket| *ticket != answer.ticket);
                let (_, stored) = all
                    .iter()
                    .find(|(request, _)| *request == answer.request)
                    .unwrap();
                // The archive that is replaced is sometimes another one, whose records are refused or another's.
                match answer.bytes {
                    Ok(bytes) if **answer.request.archive() == *NAMES[0] => {
                        assert_eq!(bytes, stored, "{}", answer.request);
                    }
                    Err(error) if **answer.request.archive() == *NAMES[0] => panic!("{error}"),
                    Ok(_) | Err(_) => {}
                }
                came += 1;
            }
        }
    }
    came
}

/// Clients that leave in the middle, send nonsense, or say nothing.
fn vandal(address: &str, seed: u64, end: &AtomicBool) {
    let (mut random, mut silent) = (Random(seed), Vec::new());
    let host = address.trim_start_matches("http://");
    while !end.load(Ordering::Relaxed) {
        let mut stream = TcpStream::connect(host).unwrap();
        stream.set_read_timeout(Some(Duration::from_millis(5))).unwrap();
        let nonsense: Vec<u8> = (0..random.below(200)).map(|_| random.below(256) as u8).collect();
        let sent: &[u8] = match random.below(6) {
            0 => b"GET /v1/leather.bsvtf HTTP/1.1\r\nhost: x\r\n\r\n",
            1 => b"GET /v1/leather.bsvtf HTTP/1.1\r\nhost: x\r\nrange: bytes=5-1,x\r\n\r\n",
            2 => b"GET /v1/leather HTTP/1.1\r\nhost: x\r\n\r\nGET /v1/ HTTP/1.1\r\nhost: x\r\n\r\nGET /v1",
            3 => b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
            4 => b"POST /v1/ HTTP/1.1\r\nhost: x\r\ncontent-length: 99999999999\r\n\r\n",
            _ => &nonsense,
        };
        // Whatever happens to it, the server must not mind.
        let _ = stream.write_all(sent);
        if random.below(2) == 0 {
            let _ = stream.read(&mut [0; 100]);
        }
        if random.below(10) == 0 && silent.len() < 50 {
            silent.push(stream);
        }
    }
}

/// Puts one archive in the place of another, over and over; ends with the right one.
fn replace(folder: &Path, end: &AtomicBool) {
    let place = folder.join(format!("{}.bsvtf", NAMES[1]));
    let put = |name: &str| {
        let new = folder.join("new");
        std::fs::copy(FIXTURE.archive(name), &new).unwrap();
        std::fs::rename(new, &place).unwrap();
    };
    while !end.load(Ordering::Relaxed) {
        for name in NAMES {
            put(name);
            std::thread::sleep(Duration::from_millis(70));
        }
    }
    put(NAMES[1]);
}

#[test]
fn memory_stays_and_what_comes_is_right() {
    let soak = match std::env::var(SECONDS) {
        Ok(seconds) => Duration::from_secs(seconds.parse().expect(SECONDS)),
        Err(_) => SOAK,
    };
    let (site, end) = (FIXTURE.site(), AtomicBool::new(false));
    let server = ServerProcess::start(site.path());
    let (address, end) = (&*server.address, &end);
    let (grown, came) = std::thread::scope(|scope| {
        let clients: Vec<_> = (0..3)
            .map(|seed| scope.spawn(move || client(address, seed, end)))
            .collect();
        scope.spawn(|| vandal(address, 7, end));
        scope.spawn(|| replace(site.path(), end));
        // Ends the others even when this one fails.
        std::thread::sleep(WARM_UP);
        let before = server.resident_bytes();
        std::thread::sleep(soak);
        let grown = server.resident_bytes().saturating_sub(before);
        end.store(true, Ordering::Relaxed);
        let came: u64 = clients.into_iter().map(|client| client.join().unwrap()).sum();
        (grown, came)
    });
    assert!(came > 100, "{came} records came");
    assert!(grown < MAX_GROWTH_BYTES, "memory grew by {grown} bytes");

    // And it still does what it should, once it has seen the archive's last change.
    let begin = Instant::now();
    for name in NAMES {
        let all = requests(name, &FIXTURE.archive(name));
        let whole = |all: &[(Request, Vec<u8>)]| {
            let (mut source, mut right) = (open_with(address, &soon()).unwrap(), 0);
            ask(&mut *source, all, |_, answer, stored| {
                right += usize::from(answer.bytes.is_ok_and(|bytes| bytes == stored));
            });
            right == all.len()
        };
        while !whole(&all) {
            assert!(begin.elapsed() < PATIENCE, "{name} does not come back");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}
