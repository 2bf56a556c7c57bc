use super::model::normalize;
use super::*;
use proptest::prelude::*;

/// What is pushed: lane, and a model and its symbol, or bits and their number.
#[derive(Clone, Copy, Debug)]
enum Item {
    Symbol(usize, usize, usize),
    Bits(usize, u32, u32),
}

fn encode(models: &[Model], items: &[Item]) -> Vec<u8> {
    let mut encoder = Encoder::default();
    for &item in items {
        match item {
            Item::Symbol(lane, model, symbol) => encoder.symbol(lane, &models[model], symbol),
            Item::Bits(lane, bits, count) => encoder.bits(lane, bits, count),
        }
    }
    encoder.finish()
}

/// Whether all items come back, and the stream is whole.
fn decodes(models: &[Model], items: &[Item], bytes: &[u8]) -> bool {
    let Ok(mut decoder) = Decoder::new(bytes) else {
        return false;
    };
    let same = items.iter().fold(true, |same, &item| {
        same & match item {
            Item::Symbol(lane, model, symbol) => decoder.symbol(lane, &models[model].buckets) == symbol,
            Item::Bits(lane, bits, count) => decoder.bits(lane, count) == bits,
        }
    });
    same & decoder.finish().is_ok()
}

fn models() -> Vec<Model> {
    let geometric: Vec<u32> = (0..30).map(|i| 1 << (29 - i)).collect();
    vec![
        Model::from_counts(&[1; 64]),
        Model::from_counts(&geometric),
        Model::from_counts(&[]),
        Model::from_counts(&[0, 0, u32::MAX, 0, 1, 0]),
    ]
}

fn item() -> impl Strategy<Value = Item> {
    prop_oneof![
        (0usize..4, 0usize..64).prop_map(|(lane, symbol)| Item::Symbol(lane, 0, symbol)),
        (0usize..4, 0usize..30).prop_map(|(lane, symbol)| Item::Symbol(lane, 1, symbol)),
        (0usize..4).prop_map(|lane| Item::Symbol(lane, 2, 0)),
        (0usize..4, 1usize..=2).prop_map(|(lane, half)| Item::Symbol(lane, 3, 2 * half)),
        (0usize..4, 0u32..=16, any::<u32>()).prop_map(|(lane, count, bits)| Item::Bits(
            lane,
            bits & ((1 << count) - 1),
            count
        )),
    ]
}

proptest! {
    #[test]
    fn symbols_and_bits_round_trip(items in prop::collection::vec(item(), 0..400)) {
        let models = models();
        let bytes = encode(&models, &items);
        prop_assert!(decodes(&models, &items, &bytes));
        if !bytes.is_empty() {
            prop_assert!(!decodes(&models, &items, &bytes[..bytes.len() - 1]));
            prop_assert!(!decodes(&models, &items, &[&bytes[..], &[1]].concat()));
        }
    }

    #[test]
    fn noise_decodes_to_symbols_of_the_alphabet(bytes in prop::collection::vec(any::<u8>(), 0..100)) {
        let models = models();
        if let Ok(mut decoder) = Decoder::new(&bytes) {
            for i in 0..1000 {
                prop_assert!(decoder.symbol(i, &models[1].buckets) < 30);
                prop_assert!(decoder.bits(i, 3) < 8);
                prop_assert!([2, 4].contains(&decoder.symbol(i, &models[3].buckets)));
            }
        }
    }

    #[test]
    fn models_keep_what_occurs_and_come_back(counts in prop::collection::vec(
        prop_oneof![Just(0), 1u32..10, any::<u32>()], 0..=64,
    )) {
        let model = Model::from_counts(&counts);
        for (symbol, &count) in counts.iter().enumerate() {
            prop_assert_eq!(model.bits(symbol).is_finite(), count > 0 || counts.iter().all(|&c| c == 0) && symbol == 0);
        }
        let mut bytes = Vec::new();
        write_models(&[model.clone(), model.clone()], &mut bytes);
        bytes.push(9);
        let mut rest = &bytes[..];
        let read = read_models(&mut rest, 2).unwrap();
        prop_assert_eq!(rest, [9]);
        prop_assert!(read.iter().all(|read| read.frequencies == model.frequencies));
        prop_assert!(read_models(&mut &bytes[..], 1).is_err());
        for length in 0..bytes.len() - 1 {
            prop_assert!(read_models(&mut &bytes[..length], 2).is_err());
        }
    }

    #[test]
    fn noise_is_no_panic_for_models(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = read_models(&mut &bytes[..], MAX_MODELS);
    }
}

#[test]
fn length_is_close_to_the_entropy() {
    let counts = [9000, 500, 300, 150, 40, 9, 1];
    let sum: u32 = counts.iter().sum();
    let model = Model::from_counts(&counts);
    // Each symbol as often as it was counted, in an order that mixes them.
    let mut symbols: Vec<usize> = (0..).zip(counts).flat_map(|(s, n)| vec![s; n as usize]).collect();
    symbols.sort_by_key(|&symbol| (symbol as u32).wrapping_mul(2_654_435_761) >> 7);
    let items: Vec<Item> = (0..)
        .zip(&symbols)
        .map(|(i, &s): (usize, _)| Item::Symbol(i % 4, 0, s))
        .collect();
    let entropy: f64 = counts
        .iter()
        .map(|&count| f64::from(count) * (f64::from(sum) / f64::from(count)).log2())
        .sum();
    let bytes = encode(&[model], &items).len() as f64;
    assert!(
        bytes < entropy / 8.0 * 1.003 + 16.0,
        "{bytes} bytes for {entropy} bits"
    );
    assert!(bytes > entropy / 8.0);
}

#[test]
fn normalization_is_the_best_there_is() {
    // Against all frequencies of three symbols.
    for counts in [[1000, 10, 1], [5, 5, 5], [70_000, 69_999, 2], [1, 1, 1_000_000]] {
        let length = |frequencies: &[u16]| -> f64 {
            (0..3)
                .map(|i| f64::from(counts[i]) * -f64::from(frequencies[i]).log2())
                .sum()
        };
        let best = (1..4095u16)
            .flat_map(|a| (1..4096 - a).map(move |b| [a, b, 4096 - a - b]))
            .map(|frequencies| length(&frequencies))
            .fold(f64::INFINITY, f64::min);
        assert!(length(&normalize(&counts)) <= best + 1e-6 * best.abs());
    }
}
