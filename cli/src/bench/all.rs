//! `eigentile bench all`: every measurement, one after the other, into one folder.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use ::benches::report::{Origin, Report};
use anyhow::{Context, Result, ensure};
use clap::Args;
use scenes::Surface;

use crate::file;

/// Measure everything, one after the other, into a folder: JSON, CSV, plots and reports of each, and an overview of all.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// Small inputs, which take some minutes; the default.
    #[arg(long, conflicts_with = "full")]
    quick: bool,
    /// Inputs of full size, which take an hour or more.
    #[arg(long)]
    full: bool,
    /// The folder; what is there already is written over.
    #[arg(short, long, value_name = "DIR", default_value = "eigentile-results")]
    output: PathBuf,
    /// Only these.
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    only: Vec<String>,
}

const EXAMPLES: &str = "\
Examples:
  eigentile bench all --quick
  eigentile bench all --full -o night
  eigentile bench all --only policy,serve -o results

Each is a process of this program, whose command stands in its report and its JSON. What fails is told, and the others are measured all
the same. index.html shows all tables and plots, results.md the text and tables. Inputs are made in DIR/inputs, and used again.";

/// A measurement and its arguments: quick and full. `{}` stands for the folder of inputs.
struct Step {
    name: &'static str,
    quick: &'static str,
    full: &'static str,
    /// Whether it draws a plot.
    plot: bool,
}

const fn step(name: &'static str, plot: bool, quick: &'static str, full: &'static str) -> Step {
    Step {
        name,
        quick,
        full,
        plot,
    }
}

const STEPS: [Step; 10] = [
    step("stability", false, "", "--full"),
    step("endurance", false, "--minutes 10", ""),
    step("policy", true, "--frames 60 --pages 100,400,1600,6400", ""),
    step(
        "codec",
        false,
        "{}/cloth.npy --keep {}/kept --components 32 --targets 0.12,0.05 --runs 3",
        "{}/cloth.npy --keep {}/kept",
    ),
    step(
        "engine",
        false,
        "--size 160x90 --frames 4 --flight 24 --rounds 2 --still 20",
        "--rounds 5",
    ),
    step(
        "memory-quality",
        true,
        "{}/scene.gltf --tiles {} --reference {} --size 192x108 --steps 5 --ranks 1,0.25",
        "{}/scene.gltf --tiles {} --reference {} --size 640x360",
    ),
    step(
        "time-error",
        true,
        "--size 160x90 --texels 64 --frames 2 --rounds 3",
        "--size 640x360 --texels 256 --components 100",
    ),
    step(
        "scale",
        false,
        "--materials 1,10,100,1000 --sides 256,2048 --size 160x90 --frames 20",
        "",
    ),
    step(
        "stream",
        true,
        "--materials 4 --size 192x108 --network 4g --network dsl --seconds 0 --stands 2",
        "",
    ),
    step(
        "serve",
        true,
        "{}/cloth.bsvtf --rounds 3 --seconds 1 --idle 100 --busy 100 --requests 20000",
        "{}/cloth.bsvtf",
    ),
];

/// What is made first: quick and full.
const INPUTS: [(&str, &str, &str); 3] = [
    (
        "cloth.npy",
        "synth cloth --size 128 --sampling sparse31 -o {}/cloth.npy",
        "synth cloth --size 256 -o {}/cloth.npy",
    ),
    (
        "cloth.bsvtf",
        "preprocess {}/cloth.npy -o {}/cloth.bsvtf --components 32",
        "preprocess {}/cloth.npy -o {}/cloth.bsvtf",
    ),
    ("scene.gltf", "", ""),
];

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    for name in &arguments.only {
        let names = STEPS.map(|step| step.name).join(", ");
        ensure!(
            names.split(", ").any(|known| known == name),
            "--only {name}: expected one of {names}"
        );
    }
    let folder = &arguments.output;
    // Inputs of both sizes have a folder each, so that neither is taken for the other.
    let inputs = folder.join(if arguments.full {
        "inputs/full"
    } else {
        "inputs/quick"
    });
    file::make_folder(&inputs)?;
    let program = std::env::current_exe().context("cannot find this program")?;
    let words = |text: &str| -> Vec<String> {
        let words = text.split_whitespace();
        words
            .map(|word| word.replace("{}", &inputs.display().to_string()))
            .collect()
    };
    for (name, quick, full) in INPUTS {
        let path = inputs.join(name);
        if path.is_file() {
            continue;
        }
        eprintln!("== {name}");
        if name == "scene.gltf" {
            scene(&path)?;
            continue;
        }
        let status = Command::new(&program)
            .args(words(if arguments.full { full } else { quick }))
            .stdout(Stdio::null())
            .status()
            .with_context(|| format!("cannot start {}", program.display()))?;
        ensure!(status.success(), "{name} could not be made: {status}");
    }
    let mut failed = Vec::new();
    let chosen = STEPS
        .iter()
        .filter(|step| arguments.only.is_empty() || arguments.only.iter().any(|name| name == step.name));
    for step in chosen {
        eprintln!("== {}", step.name);
        let watch = Instant::now();
        let at = |extension: &str| folder.join(format!("{}.{extension}", step.name));
        let mut given = vec!["bench".to_owned(), step.name.to_owned()];
        given.extend(words(if arguments.full { step.full } else { step.quick }));
        given.push("--json".into());
        let mut command = Command::new(&program);
        command
            .args(&given)
            .arg("--report")
            .arg(at("html"))
            .arg("--csv")
            .arg(at("csv"))
            .arg("--markdown")
            .arg(at("md"));
        if step.plot {
            command.arg("--plot").arg(at("svg"));
        }
        if step.name == "memory-quality" {
            command.arg("--pictures").arg(folder.join("pictures"));
        }
        // A measurement that fails leaves no half of its JSON.
        let part = at("json.part");
        let output = File::create(&part).with_context(|| format!("cannot write {}", part.display()))?;
        let status = command.stdout(output).status();
        match status {
            Ok(status) if status.success() => fs::rename(&part, at("json"))
                .with_context(|| format!("cannot write {}", at("json").display()))?,
            Ok(status) => failed.push(format!("{}: {status}", step.name)),
            Err(error) => failed.push(format!("{}: {error}", step.name)),
        }
        let _ = fs::remove_file(&part); // gone if all went well
        eprintln!("== {}: {:.0} s", step.name, watch.elapsed().as_secs_f64());
    }
    overview(folder, &failed)?;
    eprintln!("{}", folder.join("index.html").display());
    ensure!(
        failed.is_empty(),
        "{} failed: {}",
        failed.len(),
        failed.join("; ")
    );
    Ok(())
}

/// The grid of tori, all of cloth, with one view: of many along the flight the one that is nearest to what it looks at.
fn scene(path: &Path) -> Result<()> {
    let subject = ::benches::engine::built_in(1, 240, 0)?;
    let mut scene = subject.scene;
    for material in &mut scene.materials {
        if let Surface::Btf { archive, .. } = &mut material.surface {
            *archive = "cloth".into();
        }
    }
    let distance = |camera: &scenes::Camera| camera.eye.distance(camera.target);
    let nearest = subject.cameras.into_iter();
    scene.cameras = nearest
        .min_by(|a, b| distance(a).total_cmp(&distance(b)))
        .into_iter()
        .collect();
    Ok(scenes::gltf::save(&scene, path)?)
}

/// index.html and results.md of all results that are in the folder.
fn overview(folder: &Path, failed: &[String]) -> Result<()> {
    let mut page = Report::new("Measurements");
    let mut document = String::from("# Measurements\n");
    if !failed.is_empty() {
        let text = format!("Failed: {}.", failed.join("; "));
        document += &format!("\n{text}\n");
        page = page.text(text);
    }
    for step in &STEPS {
        // What was not measured, now or before, is not there.
        let Ok(text) = fs::read_to_string(folder.join(format!("{}.md", step.name))) else {
            continue;
        };
        document += &format!("\n## {}\n\n{text}", step.name);
        page = page.heading(step.name);
        let svg = format!("{}.svg", step.name);
        if let Ok(plot) = fs::read_to_string(folder.join(&svg)) {
            document += &format!("\n![{}]({svg})\n", step.name);
            page = page.plots(vec![plot]);
        }
        page = page.text(text);
    }
    file::write(&folder.join("results.md"), document.as_bytes())?;
    file::write(
        &folder.join("index.html"),
        page.html(&Origin::here(None)).as_bytes(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is measured at night must not fail for a word that is no argument.
    #[test]
    fn all_steps_are_commands() {
        use clap::Parser;
        for step in &STEPS {
            for words in [step.quick, step.full] {
                let words = words.replace("{}", "inputs");
                let given = ["eigentile", "bench", step.name]
                    .into_iter()
                    .chain(words.split_whitespace());
                crate::Program::try_parse_from(given).unwrap();
            }
        }
    }
}
