//! Hard BTFs in hard views, drawn, on small sizes.

use benches::stability::{Sizes, cases, pictures, pictures_table};

#[test]
fn every_pixel_is_finite_and_as_right_as_its_archive() {
    let rows = pictures(&cases(Sizes::Small), &|_| ()).unwrap();
    let text = pictures_table(&rows);
    println!("{text}");
    assert!(rows.iter().all(|row| row.broken.is_empty()), "\n{text}");
    assert!(!text.contains("FAIL"));
    // The views are not empty, and errors are those of real pictures.
    assert!(
        rows.iter()
            .any(|row| row.pixels == 1 && row.view.starts_with("minified"))
    );
    // Pages without a record are drawn as they are decoded, to rounding, though renderers filter their parents otherwise than decoders do.
    let strict = rows.iter().filter(|row| row.rounding_bound < 1e-3);
    assert!(
        strict
            .filter(|row| row.pages_not_stored > 0 && row.rounding.is_some())
            .count()
            > 10
    );
    assert!(rows.iter().any(|row| row.error.is_some_and(|error| error > 0.01)));
    assert_eq!(
        rows.iter().filter(|row| row.error.is_none()).count() * 9,
        rows.len()
    );
}
