//! Every knob on a small scene: the program's defaults are among the best, judged by what does not depend on the machine.

use benches::report::Origin;
use benches::time_error::{Family, Input, Judge, Knob, Plan, measure, plot, report, table};
use preprocess::Settings;

#[test]
fn defaults_lie_on_the_front() {
    let input = Input::Made {
        texels: 64,
        frames: 2,
    };
    let plan = Plan {
        size: (96, 54),
        rounds: 1,
        most_bytes: 256 << 20,
    };
    let settings = Settings {
        components: 32,
        memory_bytes: 256 << 20,
        ..Settings::default()
    };
    let results = measure(input, &plan, &settings, &|_| ()).unwrap();
    let mut knobs: Vec<_> = results.families.iter().map(|family| family.knob).collect();
    // Adapters without half floats say so.
    if let [skipped] = &results.skipped[..] {
        assert!(skipped.starts_with(Knob::Arithmetic.title()), "{skipped}");
        knobs.insert(4, Knob::Arithmetic);
    }
    assert_eq!(
        knobs,
        [
            Knob::Components,
            Knob::CutOff,
            Knob::Angular,
            Knob::Filter,
            Knob::Arithmetic,
            Knob::PageFormat,
            Knob::Quantizer,
            Knob::Passes
        ]
    );
    for family in &results.families {
        if let Some(by) = family.beats_default(Judge::Counted) {
            panic!(
                "{}: the default {:?} is dominated by {:?}",
                family.knob.title(),
                family.points[family.default],
                family.points[by]
            );
        }
        for point in &family.points {
            let finite = [point.ms, point.ratio, point.noise, point.work, point.error];
            assert!(
                finite.iter().all(|value| value.is_finite() && *value >= 0.0),
                "{point:?}"
            );
            assert!(point.ms > 0.0 && point.work > 0.0, "{point:?}");
        }
    }
    let family = |knob| results.families.iter().find(|family| family.knob == knob);
    let wanted = [
        Knob::Components,
        Knob::CutOff,
        Knob::Angular,
        Knob::Filter,
        Knob::PageFormat,
        Knob::Quantizer,
        Knob::Passes,
    ];
    let [
        Some(components),
        Some(cut_off),
        Some(angular),
        Some(filter),
        Some(pages),
        Some(quantizer),
        Some(passes),
    ] = wanted.map(family)
    else {
        panic!("{knobs:?}");
    };
    // All groups make the best picture but for what the cut-off leaves out; fewer make a worse one in less.
    assert!(falling(components, |point| point.work) && rising(components, |point| point.error));
    assert!(components.points[4].error > 0.02 && components.points[4].work < 0.3 * components.points[0].work);
    // The exact sum is exact; a larger cut-off never takes more work, and what it costs is what was allowed.
    assert_eq!(cut_off.points[0].error, 0.0);
    assert!(falling(cut_off, |point| point.work) && rising(cut_off, |point| point.error));
    let default = &cut_off.points[cut_off.default];
    assert!(default.error < 5e-3, "{default:?}");
    assert!(cut_off.points[6].work < 0.5 * cut_off.points[0].work);
    assert!(
        angular.points[1].work < 0.6 * angular.points[0].work
            && angular.points[1].error > angular.points[0].error
    );
    // One mip for two: fewer samples, another picture.
    assert!(filter.points[1].work < filter.points[0].work && filter.points[1].error > 1e-3);
    assert!(pages.points[1].bytes < pages.points[0].bytes && pages.points[1].error > pages.points[0].error);
    assert!(falling(quantizer, |point| point.work) && rising(quantizer, |point| point.error));
    let rank = passes.points[passes.default].error;
    let whole = quantizer.points[quantizer.default].error_of_btf.unwrap();
    assert!(whole > rank && whole < 2.0 * rank, "{whole} {rank}");
    assert!(passes.points[0].error > passes.points[5].error, "{passes:?}");

    let text = table(&results);
    assert!(
        text.matches(", default** |").count() == results.families.len() && !text.contains("NaN"),
        "{text}"
    );
    let svg = plot(&results);
    assert!(svg.matches("relative RMSE to").count() == results.families.len() && svg.ends_with("</svg>\n"));
    let page = report(&results).html(&Origin::here(None));
    assert!(page.matches("<h2>").count() == results.families.len() && page.ends_with("</html>\n"));
    // What is kept as JSON comes back.
    let kept = serde_json::to_string(&results).unwrap();
    assert_eq!(
        serde_json::from_str::<benches::time_error::Results>(&kept).unwrap(),
        results
    );
}

fn falling(family: &Family, of: fn(&benches::time_error::Point) -> f64) -> bool {
    family.points.is_sorted_by(|a, b| of(a) >= of(b))
}

fn rising(family: &Family, of: fn(&benches::time_error::Point) -> f64) -> bool {
    family.points.is_sorted_by(|a, b| of(a) <= of(b))
}
