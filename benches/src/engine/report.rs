//! Results for people.

use std::fmt::Write;

use super::Case;

/// What is aimed at: frame time of virtual over resident, and milliseconds of the CPU besides submission.
const RATIO_GOAL: f64 = 1.10;
const CPU_GOAL_MS: f64 = 1.0;

/// Five tables in Markdown.
pub fn table(cases: &[Case]) -> String {
    [frames, processor, skipped, saved, memory]
        .map(|table| table(cases))
        .join("\n")
}

fn table_of(write: impl FnOnce(&mut String) -> std::fmt::Result) -> String {
    let mut text = String::new();
    let _ = write(&mut text); // writing to a string cannot fail
    text
}

/// Frames with and without virtual textures.
pub fn frames(cases: &[Case]) -> String {
    table_of(|text| write_frames(text, cases))
}

/// The CPU by phase.
pub fn processor(cases: &[Case]) -> String {
    table_of(|text| write_processor(text, cases))
}

/// Work that was not needed.
pub fn skipped(cases: &[Case]) -> String {
    table_of(|text| write_skipped(text, cases))
}

/// What is done with skipping and without, and the time that it saves.
pub fn saved(cases: &[Case]) -> String {
    table_of(|text| write_saved(text, cases))
}

/// What takes memory, and frames a second.
pub fn memory(cases: &[Case]) -> String {
    table_of(|text| write_memory(text, cases))
}

fn write_frames(text: &mut String, cases: &[Case]) -> std::fmt::Result {
    writeln!(
        text,
        "| virtual / resident, ms | frame | ratio (at most {RATIO_GOAL:.2}) | median of pairs | visibility | feedback | classify | shade | tonemap |\n|---|---|---:|---:|---|---:|---|---|---|"
    )?;
    for case in cases {
        let (with, without) = (case.duel.virtual_ms, case.duel.resident_ms);
        let pair = |with: f64, without: f64| {
            if case.duel.timestamps {
                format!("{with:.2} / {without:.2} = {:.2}", with / without.max(1e-9))
            } else {
                "–".into()
            }
        };
        writeln!(
            text,
            "| {} | {:.2} / {:.2} | **{:.3}** | {:.3} | {} | {:.2} | {} | {} | {} |",
            if case.duel.without_table {
                case.name.clone()
            } else {
                format!("{}, resident by page table", case.name)
            },
            with.frame,
            without.frame,
            case.duel.ratio,
            case.duel.median_ratio,
            pair(with.visibility, without.visibility),
            with.feedback,
            pair(with.classify, without.classify),
            pair(with.shade, without.shade),
            pair(with.tonemap, without.tonemap),
        )?;
    }
    Ok(())
}

fn write_processor(text: &mut String, cases: &[Case]) -> std::fmt::Result {
    writeln!(
        text,
        "| CPU in a frame, ms | besides submission (under {CPU_GOAL_MS:.0}) | 95 % | with waiting | 95 % | votes | residency | source | decode | upload | submission |\n|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|"
    )?;
    for case in cases {
        let motion = &case.motion;
        let passed = [motion.wall_ms.all, motion.wall_ms_95.all].map(|ms| format!("{ms:.3}"));
        let moving = (&motion.cpu_ms, motion.cpu_ms_95.all, passed);
        let still = (
            &case.still.cpu_ms,
            case.still.cpu_ms_95.all,
            ["–".into(), "–".into()],
        );
        for (what, (cpu, most, [passed, most_passed])) in [("in motion", moving), ("still", still)] {
            writeln!(
                text,
                "| {}, {what} | {:.3} | {most:.3} | {passed} | {most_passed} | {:.3} | {:.3} | {:.3} | {:.3} | {:.3} | {:.3} |",
                case.name, cpu.all, cpu.votes, cpu.residency, cpu.source, cpu.decode, cpu.upload, cpu.submit
            )?;
        }
    }
    Ok(())
}

fn write_skipped(text: &mut String, cases: &[Case]) -> std::fmt::Result {
    writeln!(
        text,
        "| skipped | pages that no view wants | groups left out | groups absent | pixels not shaded | tiles not shaded | frames not drawn, still | votes asked, still | bytes of votes to all counters | records from the host | pages without a record | requests cancelled |\n|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|"
    )?;
    for case in cases {
        let skipped = &case.skipped;
        let share = |part: u64, whole: u64| 100.0 * part as f64 / whole.max(1) as f64;
        let groups: u64 = skipped.groups.iter().sum();
        let [started, tiles] = skipped.workgroups;
        let counters = &case.motion.counters;
        writeln!(
            text,
            "| {} | {:.1} % | {:.1} % | {:.1} % | {:.1} % | {:.1} % | {} of {} | {} | {:.0} of {:.0} | {} | {} | {} |",
            case.name,
            share(skipped.pages - skipped.pages_wanted, skipped.pages),
            share(skipped.groups[1], groups),
            share(skipped.groups[2], groups),
            share(skipped.pixels_empty, skipped.pixels),
            share(tiles.saturating_sub(started), tiles),
            case.still.frames - case.still.drawn,
            case.still.frames,
            case.still.asked,
            skipped.vote_bytes[0],
            skipped.vote_bytes[1],
            counters.records_from_host,
            counters.pages_not_stored,
            counters.requests_cancelled,
        )?;
    }
    Ok(())
}

fn write_saved(text: &mut String, cases: &[Case]) -> std::fmt::Result {
    writeln!(
        text,
        "| saved: with skipping / without | pages | decodes | kB | ms to load | of these uploads | fetches of groups | ms of a drawn frame | pixels | ms of shading | frames drawn, still | ms of a still frame | ms of feedback |\n|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|"
    )?;
    for case in cases {
        let (skipped, saved) = (&case.skipped, &case.saved);
        let pair = |[with, without]: [f64; 2]| match without > 0.0 {
            true => format!("{with:.2} / {without:.2}"),
            false => "–".into(), // not measured
        };
        let [fetched, left_out, absent] = skipped.groups;
        writeln!(
            text,
            "| {} | {} / {} | {} / {} | {:.0} / {:.0} | {} | {} | {fetched} / {} | {} | {} / {} | {} | {} / {} | {} | {} |",
            case.name,
            skipped.pages_wanted,
            skipped.pages,
            saved.stored_pages[0],
            saved.stored_pages[1],
            saved.page_bytes[0] as f64 / 1e3,
            saved.page_bytes[1] as f64 / 1e3,
            pair(saved.load_ms),
            pair(saved.upload_ms),
            fetched + left_out + absent,
            pair(saved.groups_ms),
            skipped.pixels - skipped.pixels_empty,
            skipped.pixels,
            pair(saved.pixels_ms),
            case.still.drawn,
            case.still.frames,
            pair(saved.still_ms),
            pair(saved.feedback_ms),
        )?;
    }
    Ok(())
}

fn write_memory(text: &mut String, cases: &[Case]) -> std::fmt::Result {
    writeln!(
        text,
        "| memory | triangles | GPU MiB | host MiB | frames a second, virtual | error left when resident |\n|---|---:|---:|---:|---:|---:|"
    )?;
    for case in cases {
        let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
        writeln!(
            text,
            "| {} | {} | {:.1} | {:.1} | {:.1} | {:.5} |",
            case.name,
            case.triangles,
            mib(case.gpu_bytes),
            mib(case.host_bytes),
            case.duel.frames_per_second,
            case.resident_rms
        )?;
    }
    Ok(())
}
