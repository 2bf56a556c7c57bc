//! `eigentile scene`: the scenes of the paper's evaluation, with all their materials.

mod blend;
mod estimate;
mod materials;
mod traced;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Result, bail, ensure};
use clap::Args;
use scenes::paper::{PaperScene, Recipe};
use scenes::synth::Sampling;
use serde::Serialize;

use crate::synth::Directions;
use crate::{bytes, file};
use estimate::Estimate;
use materials::{Made, Plan};

/// Make one of the six scenes that the paper of 2013 measures: glTF, camera path, and archives of its materials.
#[derive(Args)]
#[command(after_help = examples())]
pub(crate) struct Arguments {
    /// Which scene; without a name they are listed. `all` makes one after the other.
    name: Option<String>,
    /// Folder: the scene goes to DIR/NAME, archives to DIR/tiles, where scenes share them; drafts have names of their own there.
    #[arg(short, long, default_value = "eigentile-scenes", value_name = "DIR")]
    output: PathBuf,
    /// A draft in minutes: a quarter of the texels along each side, 31 × 31 directions, 48 components.
    #[arg(long)]
    quick: bool,
    /// Texels along each side of the scene's largest materials; smaller ones shrink with them.
    #[arg(long, value_name = "TEXELS")]
    material_size: Option<u32>,
    /// Directions of views and lights; bonn81 without --quick.
    #[arg(long, value_enum)]
    sampling: Option<Directions>,
    /// Terms of the factorization; 100 without --quick.
    #[arg(long)]
    components: Option<u32>,
    /// Share of the paper's triangles, 0.001 to 1.
    #[arg(long, default_value_t = 1.0, value_name = "SHARE")]
    triangles: f32,
    /// Writes scene and camera path only.
    #[arg(long)]
    no_materials: bool,
    /// Prints what was made as JSON, and no progress.
    #[arg(long)]
    json: bool,
}

fn examples() -> String {
    let list = PaperScene::ALL.map(|scene| format!("  {:10} {}\n", scene.name(), scene.description()));
    format!(
        "Scenes:\n{}\nExamples:\n  eigentile scene tori --quick -o scenes\n  \
         eigentile render scenes/tori/scene.gltf --tiles scenes/tiles --camera scenes/tori/camera.json -o pictures\n  \
         eigentile scene dense --no-materials --triangles 0.1\n  \
         eigentile scene all -o scenes\n\n\
         What is there with the same parameters is used again, and an interrupted run goes on where it was.",
        list.concat()
    )
}

/// Terms of the factorization at full size.
const FULL_COMPONENTS: u32 = 100;

/// What was made.
#[derive(Serialize)]
struct Report {
    scene: &'static str,
    gltf: PathBuf,
    camera_path: PathBuf,
    tiles: PathBuf,
    triangles: usize,
    scene_bytes: u64,
    archive_bytes: u64,
    materials: Vec<Made>,
    seconds: f64,
}

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let Some(name) = &arguments.name else {
        return list(arguments);
    };
    ensure!(
        (0.001..=1.0).contains(&arguments.triangles),
        "--triangles is {}; choose a share from 0.001 to 1",
        arguments.triangles
    );
    let chosen = match (name.as_str(), PaperScene::find(name)) {
        ("all", _) => PaperScene::ALL.to_vec(),
        (_, Some(scene)) => vec![scene],
        _ => {
            let names = PaperScene::ALL.map(PaperScene::name);
            bail!(
                "there is no scene {name:?}; there are {}, or all",
                names.join(", ")
            );
        }
    };
    // What cannot be made is said before anything is.
    for scene in &chosen {
        plan(arguments, *scene)?.check()?;
    }
    let mut reports = Vec::new();
    for scene in chosen {
        reports.push(make(arguments, scene)?);
    }
    if arguments.json {
        return file::print_json(&reports);
    }
    Ok(())
}

/// A smaller objects scene for measurements, in a folder: fifteen materials of 192² to 768² texels and 64 components, made where they
/// are missing, which takes a minute or two. Returns the scene's file and the folder of its archives.
pub(crate) fn objects_to_measure(folder: &Path, quiet: bool) -> Result<(PathBuf, PathBuf)> {
    let arguments = Arguments {
        name: None,
        output: folder.to_owned(),
        quick: false,
        material_size: Some(768),
        sampling: Some(Directions::Sparse31),
        components: Some(64),
        triangles: 0.03,
        no_materials: false,
        json: quiet,
    };
    let report = make(&arguments, PaperScene::Objects)?;
    Ok((report.gltf, report.tiles))
}

/// What to make of a scene. Archives that are not of full size have their parameters in their names: scenes share a folder, and what one
/// shows must never become what another one was made with.
fn plan(arguments: &Arguments, scene: PaperScene) -> Result<Plan> {
    let recipes = scene.recipes();
    let largest = recipes.iter().map(|recipe| recipe.size).max().unwrap_or(1);
    let shrink = if arguments.quick { 4 } else { 1 };
    let wanted = arguments.material_size.unwrap_or(largest / shrink);
    ensure!(
        (4..=largest).contains(&wanted),
        "--material-size is {wanted}; choose 4 to {largest}, which is what {} has",
        scene.name()
    );
    let sampling = match (arguments.sampling, arguments.quick) {
        (Some(directions), _) => directions.sampling(),
        (None, true) => Sampling::Sparse31,
        (None, false) => Sampling::Bonn81,
    };
    let components = arguments
        .components
        .unwrap_or(if arguments.quick { 48 } else { FULL_COMPONENTS });
    let sized = |recipe: Recipe| {
        // Large materials are made of four patches along each side.
        let size = (u64::from(recipe.size) * u64::from(wanted) / u64::from(largest)).max(4) as u32 & !3;
        let full = (recipe.size, Sampling::Bonn81, FULL_COMPONENTS);
        let archive = if (size, sampling, components) == full {
            recipe.archive
        } else {
            let directions = sampling.directions().len();
            format!("{}-{size}x{directions}x{components}", recipe.archive)
        };
        Recipe {
            archive,
            size,
            ..recipe
        }
    };
    Ok(Plan {
        folder: arguments.output.clone(),
        recipes: recipes.into_iter().map(sized).collect(),
        sampling,
        components,
        quiet: arguments.json,
    })
}

fn make(arguments: &Arguments, scene: PaperScene) -> Result<Report> {
    let start = Instant::now();
    let folder = arguments.output.join(scene.name());
    file::make_folder(&folder)?;
    let plan = plan(arguments, scene)?;
    let archives: Vec<String> = plan.recipes.iter().map(|recipe| recipe.archive.clone()).collect();
    let (gltf, camera_path) = scene.save(&folder, arguments.triangles, &archives)?;
    let scene_bytes = size_of(&gltf) + size_of(&gltf.with_extension("bin"));
    let triangles = scenes::gltf::load(&gltf)?.triangle_count();
    say(
        arguments,
        &format!(
            "{}: {triangles} triangles, {}, in {:.1} s",
            gltf.display(),
            bytes::text(scene_bytes),
            start.elapsed().as_secs_f64()
        ),
    );
    let mut materials = Vec::new();
    if !arguments.no_materials {
        let missing = plan.missing();
        if !missing.is_empty() {
            say(
                arguments,
                &format!(
                    "{} of {} materials to make: {}",
                    missing.len(),
                    plan.recipes.len(),
                    Estimate::of(&plan, &missing).text()
                ),
            );
        }
        materials = plan.make()?;
    }
    let report = Report {
        scene: scene.name(),
        tiles: arguments.output.join("tiles"),
        triangles,
        scene_bytes,
        archive_bytes: materials.iter().map(|made| made.archive_bytes).sum(),
        materials,
        seconds: start.elapsed().as_secs_f64(),
        gltf,
        camera_path,
    };
    if !report.materials.is_empty() {
        say(
            arguments,
            &format!(
                "{} materials, {}, in {:.0} s. To see them:\n  eigentile render {} --tiles {} --camera {} -o pictures",
                report.materials.len(),
                bytes::text(report.archive_bytes),
                report.seconds,
                report.gltf.display(),
                report.tiles.display(),
                report.camera_path.display(),
            ),
        );
    }
    Ok(report)
}

/// Names, what they are, and what making them takes.
fn list(arguments: &Arguments) -> Result<()> {
    use std::io::Write;
    let mut text = String::new();
    for scene in PaperScene::ALL {
        text += &format!("{:10} {}\n", scene.name(), scene.description());
        for (label, quick) in [("full", false), ("--quick", true)] {
            let plan = plan(
                &Arguments {
                    name: None,
                    output: arguments.output.clone(),
                    quick,
                    ..*arguments
                },
                scene,
            )?;
            let all: Vec<&Recipe> = plan.recipes.iter().collect();
            text += &format!("{:10}   {label}: {}\n", "", Estimate::of(&plan, &all).text());
        }
    }
    text += "\nMake one with: eigentile scene NAME --quick -o DIR\n";
    Ok(std::io::stdout().lock().write_all(text.as_bytes())?)
}

fn size_of(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |metadata| metadata.len())
}

fn say(arguments: &Arguments, what: &str) {
    if !arguments.json {
        eprintln!("{what}");
    }
}
