//! The stability suite on small sizes, and that its judge can say no.

use benches::stability::{Bounds, Case, Measured, Sizes, cases, examine, measure, run, table};
use preprocess::factorize::factorize;
use preprocess::{Factors, Settings};

#[test]
fn every_bound_holds_on_small_sizes() {
    let rows = run(Sizes::Small, &|_| ());
    let text = table(&rows);
    println!("{text}");
    assert!(rows.iter().all(|row| row.broken.is_empty()), "\n{text}");
    assert!(!text.contains("FAIL"));
    assert_eq!(text.lines().count(), rows.len() + 1);
    let json = serde_json::to_value(&rows).unwrap();
    assert_eq!(json[0]["case"], "zero");
    assert!(json[0]["measured"]["rank"].as_u64() == Some(1));
}

fn find(name: &str) -> Case {
    let case = cases(Sizes::Small).into_iter().find(|case| case.name == name);
    case.unwrap_or_else(|| panic!("no case {name}"))
}

/// What is broken once `harm` was done to the factors of a case.
fn broken(name: &str, harm: impl Fn(&mut Factors)) -> String {
    let case = find(name);
    let input = case.input();
    let btf = input.btf("case").unwrap();
    let settings = Settings {
        components: case.components as u32,
        memory_bytes: 1 << 30,
        ..Settings::default()
    };
    let mut factors = factorize(&btf, &settings, &|_| ()).unwrap();
    harm(&mut factors);
    let folder = tempfile::tempdir().unwrap();
    let measured = measure(&input, &btf, &factors, case.components, folder.path()).unwrap();
    case.bounds.broken(&measured).join("; ")
}

#[test]
fn broken_factors_break_bounds() {
    let name = "beyond half floats";
    assert_eq!(broken(name, |_| ()), "");
    // One entry of U' that is off by a hundredth.
    let found = broken(name, |factors| factors.u[3] += 1e-2);
    assert!(found.contains("orthonormality of U"), "{found}");
    // One component turned into another, which no longer is orthogonal to it.
    let found = broken(name, |factors| {
        let columns = factors.columns;
        factors.v.copy_within(0..columns, columns);
    });
    assert!(found.contains("orthonormality of V"), "{found}");
    assert!(found.contains("error of the truncated product"), "{found}");
    assert!(found.contains("stated minus true rank error"), "{found}");
    // A component too few.
    let found = broken(name, |factors| *factors = factors.truncated(7));
    assert!(found.starts_with("error of the truncated product"), "{found}");
    // An error that is stated too small by a twentieth.
    let found = broken(name, |factors| factors.residual_energy *= 0.9);
    assert!(found.starts_with("stated minus true rank error"), "{found}");
    // An error that is stated where there is none.
    let found = broken("rank one", |factors| {
        factors.residual_energy = 1e-6 * factors.energy
    });
    assert!(found.contains("stated minus true rank error"), "{found}");
}

#[test]
fn broken_ledgers_break_bounds() {
    let row = examine(&find("negative values")).unwrap();
    assert_eq!(row.broken, [""; 0]);
    let check = |change: fn(&mut Measured), named: &str| {
        let mut measured = row.measured.unwrap();
        change(&mut measured);
        let found = Bounds::DEFAULT.broken(&measured).join("; ");
        assert!(found.contains(named), "{found} should name {named}");
    };
    check(|m| m.half_stated *= 1.05, "stated minus true loss of half floats");
    check(|m| m.half_true = 0.002, "loss of half floats is");
    check(|m| m.total_stated *= 0.97, "stated minus true end-to-end error");
    check(|m| m.codec_stated = 4.0 * m.step, "loss of the codec");
    check(|m| m.total_true += 0.1, "end-to-end error is");
    check(|m| m.rank = 9, "components is");
    check(
        |m| m.rank_true = f64::NAN,
        "error of the truncated product is NaN",
    );
    check(|m| m.optimum *= 1.01, "optimum is");
}

#[test]
fn harm_that_is_done_elsewhere_than_stated_is_noticed() {
    let mut case = find("one NaN, repaired");
    let row = examine(&case).unwrap();
    assert_eq!(row.broken, [""; 0]);
    let repair = row.measured.unwrap().repair.unwrap();
    assert_eq!((repair.samples, repair.images), (1, 1));
    assert!(repair.loss > 0.0);
    let harm = case.harm.as_mut().unwrap();
    harm.first.3 += 1;
    let row = examine(&case).unwrap();
    assert!(
        row.broken[0].contains("the first bad sample is at"),
        "{:?}",
        row.broken
    );
    // Samples that are harmed but good, and so neither refused nor repaired.
    case.harm.as_mut().unwrap().value = 5.0;
    let text = table(&[examine(&case).unwrap()]);
    assert!(text.contains("a bad sample was taken for good"), "{text}");
    assert!(text.contains("difference of repaired samples"), "{text}");
    assert!(text.contains("miscounted repairs"), "{text}");
    assert!(text.contains("FAIL"), "{text}");
}
