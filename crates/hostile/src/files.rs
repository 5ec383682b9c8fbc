//! Readers of files, on bytes.

use std::path::{Path, PathBuf};

/// The example of a file in `docs/session.md`.
pub(crate) fn example(file: &str) -> Vec<u8> {
    let page = include_str!("../../../docs/session.md");
    let section = page.split("\n## ").find(|section| section.lines().next() == Some(file));
    let example = section.and_then(|s| s.split("```toml\n").nth(1)).and_then(|s| s.split("```").next());
    example.unwrap_or_else(|| panic!("docs/session.md has no example of {file}")).as_bytes().to_vec()
}

/// A folder with the files that the examples name.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        for file in ["vehicle.toml", "model.toml"] {
            std::fs::write(folder.path().join(file), example(file)).unwrap();
        }
        std::fs::create_dir(folder.path().join("earlier")).unwrap();
        let tables = [
            (
                "inputs.csv",
                "t_s,delta_lon_rad,delta_lat_rad,omega_u_rad_s,omega_l_rad_s\n0,0,0,180,190\n1,0,0,180,190\n",
            ),
            ("control_points.csv", include_str!("../../plan/example/control_points.csv")),
            ("control_pixels.csv", "camera,name,u_px,v_px\n"),
        ];
        for (file, text) in tables {
            std::fs::write(folder.path().join(file), text).unwrap();
        }
        std::fs::write(folder.path().join("rig.toml"), example("rig.toml")).unwrap();
        for empty in ["sensors.csv", "truth.csv", "flight.ulg", "earlier/pose.csv", "cam1.mp4"] {
            std::fs::write(folder.path().join(empty), "").unwrap();
        }
        for number in [1, 2] {
            for kind in ["control.png", "wand.mp4"] {
                std::fs::write(folder.path().join(format!("cam{number}-{kind}")), "").unwrap();
            }
        }
        Self(folder)
    }
}

thread_local! {
    static FOLDER: Folder = Folder::new();
}

/// The path of a file of this thread, which may be there or not.
pub(crate) fn path(name: &str) -> PathBuf {
    FOLDER.with(|folder| folder.0.path().join(name))
}

/// What a reader of a file makes of bytes in a file of that name.
pub(crate) fn with_file<T>(name: &str, bytes: &[u8], read: impl FnOnce(&Path) -> T) -> T {
    let path = path(name);
    std::fs::write(&path, bytes).unwrap();
    read(&path)
}

/// The bytes that a writer of a file leaves.
pub(crate) fn written<E: std::fmt::Debug>(name: &str, write: impl FnOnce(&Path) -> Result<(), E>) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    write(&path).unwrap();
    std::fs::read(&path).unwrap()
}
