//! What the workspace needs beyond Rust: a Vulkan loader and a driver; and for its tests Python with numpy and Pillow,
//! nginx, curl and a screen without a screen (Xvfb), and what windows on X11 need.
//!
//! Any driver will do. Without a graphics card Mesa's software adapter (llvmpipe) draws; Debian has it in the
//! package mesa-vulkan-drivers. macOS and Windows bring Metal and DX12. Python makes the images that tests of the
//! readers compare with, nginx is a host that knows nothing of us, curl a client, Xvfb shows
//! windows to xdotool: nothing but their tests fails without them.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Result, bail};

use crate::steps::Program;

const PACKAGES: [&str; 13] = [
    "mesa-vulkan-drivers",
    "libvulkan1",
    "python3-numpy",
    "python3-pil",
    "nginx-light",
    "curl",
    "xvfb",
    "xdotool",
    "libxkbcommon-x11-0",
    "libx11-xcb1",
    "libxcursor1",
    "libxi6",
    "libxrandr2",
];

/// Finds all that is needed, or installs it, or says how to.
pub(crate) fn setup() -> Result<()> {
    if !cfg!(target_os = "linux") {
        return Ok(());
    }
    let (missing, tests) = (missing(), missing_for_tests());
    if missing.is_empty() && tests.is_empty() {
        return Ok(());
    }
    if missing.is_empty() && !(found_on_path("apt-get") && is_root()) {
        note(&tests);
        return Ok(());
    }
    eprintln!("missing: {}", [&missing[..], &tests].concat().join(", "));
    let command = format!(
        "apt-get install -y --no-install-recommends {}",
        PACKAGES.join(" ")
    );
    if !found_on_path("apt-get") {
        bail!(
            "no {}: install your distribution's Vulkan loader and a Vulkan driver; without a graphics card \
             Mesa's software driver, lavapipe (vulkan-swrast on Arch, mesa-vulkan-drivers on Fedora)",
            missing.join(", no ")
        );
    }
    if !is_root() {
        bail!("no {}: run `sudo {command}`", missing.join(", no "));
    }
    apt_install(&PACKAGES)?;
    note(&missing_for_tests());
    match self::missing() {
        missing if missing.is_empty() => Ok(()),
        missing => bail!(
            "`{command}` was run, and there is still no {}",
            missing.join(", no ")
        ),
    }
}

/// Whether packages can be installed here.
pub(crate) fn is_debian_root() -> bool {
    found_on_path("apt-get") && is_root()
}

/// Installs packages. The lists of a fresh container are empty or old: they are fetched only if the first try fails.
pub(crate) fn apt_install(packages: &[&str]) -> Result<()> {
    let install = || {
        apt_get()
            .args(["install", "-y", "--no-install-recommends"])
            .args(packages)
            .run()
    };
    install().or_else(|_| {
        apt_get().args(["update"]).run()?;
        install()
    })
}

fn apt_get() -> Program {
    Program::new("apt-get").env("DEBIAN_FRONTEND", "noninteractive")
}

/// Says what tests will miss.
fn note(tests: &[&str]) {
    if !tests.is_empty() {
        eprintln!("note: tests need {}", tests.join(", "));
    }
}

/// What is there for tests only, and is not there, by name.
fn missing_for_tests() -> Vec<&'static str> {
    let nginx = found_on_path("nginx") || Path::new("/usr/sbin/nginx").exists();
    let tools = [
        (
            has_python(),
            "python3 with numpy and Pillow (Debian: python3-numpy, python3-pil)",
        ),
        (nginx, "nginx (Debian: nginx-light)"),
        (found_on_path("curl"), "curl"),
        (found_on_path("Xvfb"), "Xvfb (Debian: xvfb)"),
        (found_on_path("xdotool"), "xdotool"),
        (
            has_libraries(&["libxkbcommon-x11.so.0", "libXcursor.so.1", "libXi.so.6"]),
            "libraries of windows (Debian: libxkbcommon-x11-0, libxcursor1, libxi6)",
        ),
    ];
    let missing = tools.into_iter().filter(|(there, _)| !there);
    missing.map(|(_, name)| name).collect()
}

/// Whether Python has what tests use: the first on the path, or that of the system.
fn has_python() -> bool {
    ["python3", "/usr/bin/python3"].into_iter().any(|python| {
        Command::new(python)
            .args(["-c", "import numpy, PIL.Image"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()
            .is_ok_and(|status| status.success())
    })
}

/// What is not there, by name.
fn missing() -> Vec<&'static str> {
    let loader = has_libraries(&["libvulkan.so.1"]);
    let chosen = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"]
        .iter()
        .any(|name| std::env::var_os(name).is_some());
    let driver = chosen || driver_folders().any(|folder| has_json(&folder));
    let mut missing = Vec::new();
    if !loader {
        missing.push("Vulkan loader (libvulkan.so.1)");
    }
    if !driver {
        missing.push("Vulkan driver (vulkan/icd.d/*.json)");
    }
    missing
}

/// Whether all of these can be loaded.
fn has_libraries(names: &[&str]) -> bool {
    names
        .iter()
        .all(|name| library_folders().any(|folder| folder.join(name).exists()))
}

/// Where a distribution puts libraries, and LD_LIBRARY_PATH.
fn library_folders() -> impl Iterator<Item = PathBuf> {
    let given = std::env::var_os("LD_LIBRARY_PATH").unwrap_or_default();
    let roots = [
        "/usr/lib",
        "/usr/lib64",
        "/lib",
        "/lib64",
        "/usr/local/lib",
        "/run/opengl-driver/lib",
    ]
    .map(PathBuf::from);
    let machines = roots
        .clone()
        .into_iter()
        .map(|root| root.join(format!("{}-linux-gnu", std::env::consts::ARCH)));
    let given: Vec<PathBuf> = std::env::split_paths(&given).collect();
    given.into_iter().chain(machines.collect::<Vec<_>>()).chain(roots)
}

/// Where the Vulkan loader looks for drivers (Khronos: Loader and Driver Interface, "Driver Discovery").
fn driver_folders() -> impl Iterator<Item = PathBuf> {
    let home = std::env::var_os("XDG_DATA_HOME")
        .map(PathBuf::from)
        .or_else(|| std::env::var_os("HOME").map(|home| Path::new(&home).join(".local/share")));
    let shared = std::env::var_os("XDG_DATA_DIRS").unwrap_or_else(|| "/usr/local/share:/usr/share".into());
    let shared: Vec<PathBuf> = std::env::split_paths(&shared).collect();
    let roots = home
        .into_iter()
        .chain(shared)
        .chain(["/etc", "/usr/local/etc", "/run/opengl-driver/share"].map(PathBuf::from));
    roots.map(|root| root.join("vulkan/icd.d"))
}

fn has_json(folder: &Path) -> bool {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.into_iter().any(|entry| {
        entry
            .path()
            .extension()
            .is_some_and(|extension| extension == "json")
    })
}

pub(crate) fn found_on_path(program: &str) -> bool {
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).any(|folder| folder.join(program).is_file())
}

/// Asks the file system: a process's own folder in /proc belongs to its user.
fn is_root() -> bool {
    #[cfg(unix)]
    return std::fs::metadata("/proc/self").is_ok_and(|own| std::os::unix::fs::MetadataExt::uid(&own) == 0);
    #[cfg(not(unix))]
    return false;
}
