//! What must not grow with the number of materials and their size does not.

use benches::scale::{Plan, measure, table};

#[test]
fn memory_besides_the_caches_follows_the_tiles() {
    let plan = Plan {
        cases: vec![(1, 256), (10, 256), (200, 256), (2, 2048)],
        size: (96, 64),
        frames: 8,
        cache_bytes: [16 << 20, 4 << 20],
    };
    let results = measure(&plan, &|_| ()).unwrap();
    let (text, rows) = (table(&results), &results.rows);
    println!("{text}");
    assert_eq!(text.lines().count(), 2 + rows.len());
    let json = serde_json::to_value(rows).unwrap();
    assert_eq!(json[2]["materials"], 200);
    // 256² are 16 + 4 + 1 tiles and the root, 2048² have 1024 + 256 + 64 more.
    assert_eq!([rows[0].tiles, rows[3].tiles], [22, 2 * (22 + 1344)]);
    // A tile is a row of two words in the page table and a counter, twice; a material some kilobytes of tables.
    let grown = |row: usize| rows[row].gpu_bytes.saturating_sub(rows[0].gpu_bytes);
    assert!(grown(2) < 200 * 16 * 1024, "\n{text}");
    assert!(grown(3) < 2 * 8 * 1024 + rows[3].tiles * 64, "\n{text}");
    // A directory entry is some bytes.
    assert!(rows[3].index_bytes < 4096 + 1366 * 40, "\n{text}");
}
