//! A small scene over two networks: the figures are complete, agree with each other, and come out the same again.

use std::time::Duration;

use benches::engine::Subject;
use benches::stream::{Contender, NamedNetwork, Plan, Results, Way, close_up, measure, plot, table};
use engine::stream::Network;

fn networks() -> Vec<NamedNetwork> {
    let named = |name: &str, network| NamedNetwork {
        name: name.into(),
        network,
    };
    vec![
        named("wide", Network::line(200_000_000, Duration::from_millis(20), 0.0)),
        named("lossy", Network::line(50_000_000, Duration::from_millis(50), 0.1)),
    ]
}

fn measured(subject: &Subject, networks: Vec<NamedNetwork>) -> Results {
    let plan = Plan {
        size: (64, 36),
        networks,
        page_cache_bytes: 64 << 20,
        column_cache_bytes: 16 << 20,
    };
    measure(subject, &subject.cameras[..1], &plan, &|_| ()).unwrap()
}

#[test]
fn contenders_end_with_the_same_picture_and_ours_is_the_first() {
    let results = measured(&close_up(1, 8).unwrap(), networks());
    assert_eq!((results.materials, results.stands, results.views), (1, 1, 8));
    assert_eq!(results.replays.len(), 2 * 2 * Contender::ALL.len());
    for replay in &results.replays {
        let of = format!("{} {:?} {:?}", replay.network, replay.way, replay.contender);
        let [first, similar, settled] =
            [replay.first, replay.similar, replay.settled].map(|mark| mark.expect(&of));
        // Where a material is a few pixels, a picture may be similar before that shows something of its own.
        assert!(first.seconds.max(similar.seconds) <= settled.seconds, "{of}");
        assert!(0 < first.bytes && similar.bytes <= settled.bytes, "{of}");
        let last = replay.points.last().unwrap();
        assert!(last.ssim > 0.999 && last.at == settled, "{of}: {last:?}");
        assert!(last.predicted_rms < 1e-6, "{of}: {last:?}");
        assert!(
            replay
                .points
                .windows(2)
                .all(|two| two[0].at.bytes <= two[1].at.bytes),
            "{of}"
        );
        assert_eq!(replay.resent_bytes > 0, replay.network == "lossy", "{of}");
        match replay.way {
            Way::Standing(_) => {
                // Bytes cannot have come faster than the line carries them.
                let (bits, trip) = if replay.network == "wide" {
                    (2e8, 0.02)
                } else {
                    (5e7, 0.05)
                };
                assert!(
                    settled.seconds > settled.bytes as f64 * 8.0 / bits + 2.0 * trip,
                    "{of}"
                );
                assert!(
                    (2..=9).contains(&replay.round_trips.unwrap()),
                    "{of}: {:?}",
                    replay.round_trips
                );
                assert!(
                    replay.aborted_bytes + replay.unseen_bytes == 0,
                    "{of}: {replay:?}"
                );
                assert!(replay.moving_ssim.is_none() && replay.stopped.is_none());
            }
            Way::Moving => {
                assert!(
                    replay.moving_ssim.is_some_and(|ssim| (0.0..=1.0).contains(&ssim)),
                    "{of}"
                );
                assert_eq!(replay.stopped.unwrap().seconds, 8.0 / 60.0);
                assert!(
                    replay.contender == Contender::Ours || replay.unseen_bytes == 0,
                    "{of}"
                );
            }
        }
    }
    // A static view needs the same records, whatever their order; ours leaves out what makes no difference.
    let bytes = |contender| {
        let mut of = results.of("wide", Way::Standing(0));
        of.find(|replay| replay.contender == contender)
            .unwrap()
            .settled
            .unwrap()
            .bytes
    };
    assert_eq!(bytes(Contender::Breadth), bytes(Contender::Demand));
    assert!(bytes(Contender::Ours) <= bytes(Contender::Breadth));
    let ours = results.of("wide", Way::Standing(0)).next().unwrap();
    assert_eq!((ours.contender, ours.round_trips), (Contender::Ours, Some(3)));

    let table = table(&results);
    assert_eq!(table.matches("| Eigentile |").count(), 4, "{table}");
    let plot = plot(&results);
    assert!(
        plot.starts_with("<svg") && plot.matches("stroke=\"#0969DA\"").count() == 5,
        "{plot}"
    );
    assert!(!plot.contains("NaN") && !plot.contains("inf"), "{plot}");
}

#[test]
fn results_are_the_same_every_time() {
    let subject = close_up(1, 1).unwrap();
    let lossy = || networks().split_off(1);
    assert_eq!(measured(&subject, lossy()), measured(&subject, lossy()));
}
