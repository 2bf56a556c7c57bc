//! The tables of docs/results.md are those of the results that are kept beside it.

use std::path::Path;

use benches::results::{fill, open};

#[test]
fn tables_of_the_document_are_those_of_the_results() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let results = open(&root.join("benches/results")).unwrap();
    assert!(results.len() >= 7, "results are not there");
    let path = root.join("docs/results.md");
    let document = std::fs::read_to_string(&path).unwrap();
    let filled = fill(&document, &results).unwrap();
    for (at, (is, should)) in document.lines().zip(filled.lines()).enumerate() {
        assert_eq!(
            is,
            should,
            "{}:{}: run `cargo xtask report`",
            path.display(),
            at + 1
        );
    }
    assert_eq!(document, filled, "run `cargo xtask report`");
    // Plots that the document shows are drawn from the same results.
    let mut shown = 0;
    for (name, svg) in results.iter().flat_map(|kept| &kept.plots) {
        if document.contains(&format!("(images/{name})")) {
            let drawn = std::fs::read_to_string(root.join("docs/images").join(name)).unwrap();
            assert!(drawn == *svg, "docs/images/{name}: run `cargo xtask report`");
            shown += 1;
        }
    }
    assert!(shown >= 4, "{shown} plots");
}
