//! What is refused, each with its place and remedy.

use crate::lab::{Lab, apart};
use mavsight::geometry::BrownConrady;
use mavsight::session::{read_rig, write_rig};

fn lab() -> Lab {
    Lab::new(BrownConrady::default())
}

/// Changes one line, counted from 1.
fn with_line(text: &str, number: usize, change: impl Fn(&str) -> String) -> String {
    let line = |(k, l): (usize, &str)| if k + 1 == number { change(l) } else { l.to_owned() };
    text.lines().enumerate().map(line).collect::<Vec<_>>().join("\n") + "\n"
}

#[test]
fn coefficients() {
    let lab = lab();
    lab.convert("rig.toml good-DLTcoefs.csv");
    let good = lab.read("good-DLTcoefs.csv");
    let first = |n: usize| good.lines().take(n).collect::<Vec<_>>().join("\n");
    let cases: [(String, &[&str]); 6] = [
        (first(10), &["10 rows", "L1 to L11"]),
        (first(8), &["planar"]),
        (
            with_line(&good, 3, |l| l.replace(l.split(',').next().expect("cells"), "NaN")),
            &["line 3", "column 1", "NaN"],
        ),
        (with_line(&good, 5, |l| l.replace(',', ";")), &["line 5", "separator"]),
        (with_line(&good, 7, |l| format!("{l},1.5")), &["line 7", "3 columns", "2"]),
        (String::new(), &["0 rows"]),
    ];
    for (text, words) in cases {
        lab.write("bad-DLTcoefs.csv", text).refuses("bad-DLTcoefs.csv out.toml --size 640x480", words);
    }
    lab.refuses("good-DLTcoefs.csv out.toml", &["--size 640x480"]);
    lab.refuses("good-DLTcoefs.csv out.toml --size 640x480,640x480,640x480", &["2 sizes", "3 given"]);
    lab.refuses("good-DLTcoefs.csv out.toml --size 640x480 --origin argus", &["argus", "down", "dltdv8"]);
    lab.refuses("good-DLTcoefs.csv out.toml --size 640x480 --cameras a,b,c", &["3 names", "2 cameras"]);
    lab.refuses("good-DLTcoefs.csv out.toml --size 640", &["640x480"]);
    lab.convert("rig.toml up-DLTcoefs.csv --origin dltdv5");
    lab.refuses("up-DLTcoefs.csv out.toml --size 640x480 --origin zero", &["zero", "up", "dltdv5"]);
    let mixed: Vec<String> = good
        .lines()
        .zip(lab.read("up-DLTcoefs.csv").lines())
        .map(|(a, b)| {
            format!("{},{}", a.split(',').next().expect("a cell"), b.split(',').nth(1).expect("a cell"))
        })
        .collect();
    lab.write("mixed-DLTcoefs.csv", mixed.join("\n"))
        .refuses("mixed-DLTcoefs.csv out.toml --size 640x480", &["1 of 2", "--origin"]);
}

#[test]
fn digitised_points() {
    let lab = lab();
    let head = "pt1_cam1_X,pt1_cam1_Y,pt1_cam2_X,pt1_cam2_Y\n";
    lab.write("good-xypts.csv", format!("{head}1,2,3,4\n5,6,NaN,NaN\n0,0,7,8\n"));
    lab.convert("good-xypts.csv markers.csv --rate 50");
    // One less than MATLAB's; NaN and exact zeros are missing.
    assert_eq!(lab.read("markers.csv").lines().count(), 1 + 4);
    assert!(lab.read("markers.csv").contains("0.040000000,cam2,pt1,6.0,7.0,1.0,1.0"));
    lab.convert("markers.csv again-xypts.tsv");
    lab.convert("again-xypts.tsv again-markers.csv --rate 50 --cameras cam1,cam2");
    assert_eq!(lab.read("markers.csv"), lab.read("again-markers.csv"));
    lab.refuses("good-xypts.csv out-markers.csv", &["--rate"]);
    lab.refuses("good-xypts.csv out-markers.csv --rate 0", &["0 Hz"]);
    lab.refuses("good-xypts.csv out-markers.csv --rate 50 --origin argus", &["--size"]);
    lab.refuses("good-xypts.csv out-markers.csv --rate 50 --points a,b", &["2 names", "1 points"]);
    lab.refuses("again-xypts.tsv out-markers.csv --rate 50", &["--cameras"]);
    for (text, words) in [
        (format!("{head}1,2,3\n"), &["line 2", "3 cells", "4"]),
        (format!("{head}1,2,x,4\n"), &["line 2", "column pt1_cam2_X", "\"x\""]),
        (head.replace("cam1_Y", "cam3_Y"), &["column 2", "pt1_cam3_Y", "pt1_cam1_V"]),
    ] {
        lab.write("bad-xypts.csv", text).refuses("bad-xypts.csv out-markers.csv --rate 50", words);
    }
    for (text, words) in [
        ("title\n2\t4\t3\n1\t1\t5\n", &["1 values", "3", "breaks off"]),
        ("title\n2\t4\t1\n3\t1\t5\n", &["line 3", "row 3", "2 by 4"]),
        ("title\n2,4,1\n", &["line 2", "tabs", "count"]),
    ] {
        lab.write("bad-xypts.tsv", text)
            .refuses("bad-xypts.tsv out-markers.csv --rate 50 --cameras a,b", words);
    }
    lab.write("bad-xyzpts.csv", "pt1_X,pt1_Y\n1,2\n")
        .refuses("bad-xyzpts.csv positions.csv --rate 50", &["2 columns"]);
    lab.write("a-offsets.csv", "cam1_offset,cam2_offset\n0,0\n0,-3\n0,-3\n")
        .convert("a-offsets.csv lines.toml --rate 50");
    assert!(lab.read("lines.toml").contains("name = \"cam2\"\ntime_offset_s = -0.06"));
    lab.write("b-offsets.csv", "cam1_offset,cam2_offset\n0,-3\n0,-4\n")
        .refuses("b-offsets.csv out.toml --rate 50", &["cam2", "-3", "-4"]);
}

#[test]
fn lenses_that_a_format_cannot_hold() {
    let lab = Lab::new(BrownConrady { k1: -0.2, k3: 0.02, ..BrownConrady::default() });
    lab.refuses("rig.toml camchain.yaml", &["cam1", "k3", "0.02"]);
    lab.refuses("rig.toml a-profile.txt", &["cam1", "focal lengths"]);
    lab.refuses("rig.toml camera_info.yaml", &["--camera", "cam1, cam2"]);
    lab.refuses("rig.toml camera_info.yaml --camera cam9", &["cam9"]);
    let mut rig = lab.rig.clone();
    for c in &mut rig.cameras {
        (c.camera.intrinsics.skew_px, c.camera.intrinsics.fy_px) = (0.7, c.camera.intrinsics.fx_px);
    }
    write_rig(&lab.path("skewed.toml"), &rig).expect("written");
    for name in ["out.yml", "a-profile.txt"] {
        lab.refuses(&format!("skewed.toml {name}"), &["cam1", "0.700 px", "--drop-skew"]);
    }
    assert!(lab.convert("skewed.toml out.yml --drop-skew").contains("is dropped"));
    assert!(lab.convert("skewed.toml a-profile.txt --drop-skew").contains("is dropped"));
    lab.convert("a-profile.txt back.toml");
    let back = read_rig(&lab.path("back.toml")).expect("a rig");
    for (a, b) in rig.cameras.iter().zip(&back.cameras) {
        assert_eq!(
            (a.camera.intrinsics.fx_px, a.camera.distortion),
            (b.camera.intrinsics.fx_px, b.camera.distortion)
        );
        assert!((a.camera.intrinsics.cy_px - b.camera.intrinsics.cy_px).abs() < 1e-12);
    }
    lab.write("b-profile.txt", "1 4 1920 1080 1 2 3\n")
        .refuses("b-profile.txt out.toml", &["line 1", "7 numbers", "cam f w h"]);
}

#[test]
fn calibrations_in_yaml() {
    let lab = lab();
    lab.convert("rig.toml good.yml");
    lab.convert("rig.toml camchain.yaml");
    lab.convert("rig.toml camera_info.yaml --camera cam1");
    let (cv, chain, info) = (lab.read("good.yml"), lab.read("camchain.yaml"), lab.read("camera_info.yaml"));
    let half = cv[..cv.find("D1").expect("a key") - 20].to_owned();
    let cases: [(&str, String, &[&str]); 15] = [
        ("a.yml", half, &["bracket", "breaks off"]),
        ("a.yml", cv.replace("rows: 1", "rows: 2"), &["5 numbers", "2 rows"]),
        ("a.yml", cv.replace("M1", "N1").replace("M2", "N2"), &["camera matrix", "N1"]),
        ("a.yml", cv.replacen("data: [ ", "data: [ nan, ", 1), &["\"nan\"", "finite"]),
        (
            "a.yml",
            cv.replace("cam_from_world_2", "lost").replace("\nR:", "\nS:"),
            &["cam_from_world_2", "missing"],
        ),
        ("a.yml", cv.replacen("   rows: 3", "\trows: 3", 1), &["tab"]),
        ("a.yml", cv.replacen("M2:", "M1:", 1), &["\"M1\"", "twice"]),
        ("camchain.yaml", chain.replace("radtan", "equidistant"), &["equidistant", "radtan"]),
        ("camchain.yaml", chain.replace("pinhole", "omni"), &["omni", "pinhole"]),
        ("camchain.yaml", chain.replace("T_cn_cnm1", "T_lost"), &["T_cn_cnm1"]),
        ("camchain.yaml", chain.replacen("  - [", "  - [9.0, ", 1), &["T_cn_cnm1", "17 numbers"]),
        ("camera_info.yaml", info.replace("plumb_bob", "equidistant"), &["equidistant", "plumb_bob"]),
        ("camera_info.yaml", info.replace("image_width", "width"), &["image_width"]),
        ("camera_info.yaml", info.replace("cols: 5", "cols: 6"), &["5 numbers"]),
        ("camera_info.yaml", "a: &x 1\n".to_string(), &["anchors"]),
    ];
    for (name, text, words) in cases {
        let from = if name.starts_with("camchain") {
            "kalibr"
        } else if name.starts_with("camera") {
            "ros"
        } else {
            "opencv"
        };
        lab.write(name, text).refuses(&format!("{name} out.toml --from {from} --size 640x480"), words);
    }
    // The rational model is read where its further coefficients are zero, and refused where not.
    let eight = |k4: &str| {
        let line = info.lines().position(|l| l.starts_with("distortion_coefficients")).expect("a key") + 1;
        let text = with_line(&info, line + 2, |_| "  cols: 8".into());
        with_line(&text, line + 3, |_| format!("  data: [-0.2, 0.1, 0.0, 0.0, 0.0, {k4}, 0.0, 0.0]"))
            .replace("plumb_bob", "rational_polynomial")
    };
    lab.write("r-camera_info.yaml", eight("0.0")).convert("r-camera_info.yaml fine.toml");
    lab.write("r-camera_info.yaml", eight("0.3"))
        .refuses("r-camera_info.yaml out.toml", &["k3", "0.3", "rational"]);
    let deep = format!("a: {}{}\n", "[".repeat(200_000), "]".repeat(200_000));
    lab.write("deep.yml", deep).refuses("deep.yml out.toml", &["deep"]);
}

#[test]
fn trajectories() {
    let lab = lab();
    lab.convert("pose.csv good.tum");
    lab.convert("pose.csv good-euroc.csv");
    let (tum, euroc) = (lab.read("good.tum"), lab.read("good-euroc.csv"));
    let swapped = |l: &str| {
        let mut c: Vec<&str> = l.split(' ').collect();
        c[7] = "3.5";
        c.join(" ")
    };
    for (text, words) in [
        (tum.replace(' ', ","), &["line 2", "spaces"]),
        (with_line(&tum, 4, |l| l.rsplit_once(' ').expect("cells").0.into()), &["line 4", "7 cells"]),
        (with_line(&tum, 4, |l| l.replacen("0.04", "nan", 1)), &["line 4", "nan"]),
        (with_line(&tum, 4, |l| format!("-{l}")), &["line 4", "sort"]),
        (with_line(&tum, 4, swapped), &["line 4", "quaternion"]),
        ("# t x\n".into(), &["no rows", "bad.tum"]),
    ] {
        lab.write("bad.tum", text).refuses("bad.tum out-pose.csv", words);
    }
    for (text, words) in [
        (with_line(&euroc, 3, |l| l.rsplit_once(',').expect("cells").0.into()), &["line 3", "7 cells"]),
        (with_line(&euroc, 3, |l| format!("0.{l}")), &["line 3", "nanoseconds"]),
    ] {
        lab.write("bad-euroc.csv", text).refuses("bad-euroc.csv out-pose.csv", words);
    }
    lab.refuses("good.tum out.c3d", &["--vehicle"]);
    lab.refuses("good.tum rig-out.toml", &["does not turn into"]);
    lab.refuses("good.tum out.xyz", &["--to"]);
    lab.write("what.bin", "x").refuses("what.bin out.csv", &["--from"]);
    lab.refuses("nowhere.tum out-pose.csv", &["nowhere.tum"]);
}

#[test]
fn marker_paths() {
    let lab = lab();
    lab.convert("pose.csv good.trc --vehicle vehicle.toml");
    lab.convert("pose.csv good.c3d --vehicle vehicle.toml");
    let trc = lab.read("good.trc");
    for (text, words) in [
        (trc.replace("\tmm\t", "\tfeet\t"), &["line 3", "feet"]),
        (trc.replace("PathFileType", "Path"), &["line 1", "PathFileType"]),
        (trc.lines().take(20).collect::<Vec<_>>().join("\n"), &["NumFrames is 25", "breaks off"]),
        (
            with_line(&trc, 8, |l| l.rsplit_once('\t').expect("cells").0.into()),
            &["line 8", "some coordinates"],
        ),
        (with_line(&trc, 8, |l| format!("{l}\t1.0")), &["line 8", "14"]),
        (trc.replace("\tred\t", "\t\t"), &["3 labels", "NumMarkers is 4"]),
    ] {
        lab.write("bad.trc", text).refuses("bad.trc out-pose.csv --vehicle vehicle.toml", words);
    }
    lab.write("other.trc", trc.replace("red", "A").replace("blue", "B")).refuses(
        "other.trc out-pose.csv --vehicle vehicle.toml",
        &["2 of the labels", "A, green, B, yellow"],
    );
    lab.refuses("good.trc out-pose.csv", &["--vehicle"]);
    let c3d = std::fs::read(lab.path("good.c3d")).expect("there");
    let mut other = c3d.clone();
    other[1] = 0;
    let mut units = c3d.clone();
    let at = units.windows(7).position(|w| w == b"\x05\x01UNITS").expect("a parameter") + 13;
    units[at..at + 2].copy_from_slice(b"ft");
    let mut many = c3d.clone();
    let at = many.windows(6).position(|w| w == b"\x04\x01USED").expect("a parameter") + 10;
    many[at..at + 2].copy_from_slice(&i16::MAX.to_le_bytes());
    for (bytes, words) in [
        (many, &["POINT:USED", "32767 points"]),
        (c3d[..c3d.len() - 1024].to_vec(), &["25 are announced", "breaks off"]),
        (c3d[..600].to_vec(), &["C3D", "bad.c3d"]),
        (other, &["C3D", "0x50"]),
        (units, &["POINT:UNITS", "ft"]),
    ] {
        lab.write("bad.c3d", bytes).refuses("bad.c3d out-positions.csv", words);
    }
    // Every cut and every flipped byte of the header and the parameters: refused or read, without a panic.
    for at in (0..2048.min(c3d.len())).step_by(97) {
        let mut flipped = c3d.clone();
        flipped[at] ^= 0xff;
        lab.write("flipped.c3d", flipped);
        let code = lab.run("flipped.c3d any-positions.csv").status.code();
        assert!(matches!(code, Some(0 | 2)), "byte {at}: {code:?}");
    }
    let uneven = "t_s,marker,x_m,y_m,z_m\n0,a,1,2,3\n0.1,a,1,2,3\n0.2,a,1,2,3\n0.24,a,1,2,3\n0.4,a,1,2,3\n";
    lab.write("positions.csv", uneven).refuses("positions.csv out.c3d", &["instant", "even clock", "TRC"]);
    lab.convert("positions.csv kept.trc");
    lab.convert("kept.trc back-positions.csv");
    assert!(lab.read("back-positions.csv").contains("0.240000000,a,1.0,2.0,3.0"));
    lab.convert("positions.csv turned.trc --up y");
    lab.convert("turned.trc back-positions.csv");
    assert!(lab.read("back-positions.csv").contains("0.000000000,a,1.0,3.0,-2.0"));
    lab.convert("turned.trc upright-positions.csv --up y");
    assert!(lab.read("upright-positions.csv").contains("0.000000000,a,1.0,2.0,3.0"));
}

#[cfg(feature = "parquet")]
#[test]
fn parquet() {
    let lab = lab();
    lab.convert("pose.csv pose.parquet");
    let bytes = std::fs::read(lab.path("pose.parquet")).expect("there");
    lab.write("cut.parquet", &bytes[..bytes.len() / 2])
        .refuses("cut.parquet out.csv", &["cut.parquet", "Parquet"]);
    lab.write("twice.csv", "a,a\n1,2\n").refuses("twice.csv out.parquet", &["column 2", "twice"]);
    lab.write("short.csv", "a,b\n1\n").refuses("short.csv out.parquet", &["line 2"]);
}

/// What has no uncertainty says so, and an object of control points comes back.
#[test]
fn what_is_lost_is_said() {
    let lab = lab();
    lab.convert("rig.toml a.yml");
    assert!(lab.convert("a.yml back.toml").contains("count as exact"));
    assert!(apart(&lab.rig, &read_rig(&lab.path("back.toml")).expect("a rig")).0 == 0.0);
    lab.write("object.csv", "x,y,z\n0,0.5,1\n1,2,3e-1\n").convert("object.csv control_points.csv");
    lab.convert("control_points.csv back-object.csv");
    assert_eq!(lab.read("back-object.csv"), "x,y,z\n0.0,0.5,1.0\n1.0,2.0,0.3\n");
    lab.write("bad-object.csv", "x,y,z\n0,0.5\n")
        .refuses("bad-object.csv out-control_points.csv", &["line 2", "three numbers"]);
}
