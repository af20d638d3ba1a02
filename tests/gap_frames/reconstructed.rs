//! Twins that `reconstruct` made, and what the program says of them by frames.

use std::{fs, process::Command};

use io::write_synth_bag;
use synth::{SynthConfig, film_take};

use crate::{
    case::{Folder, film_and_diagnose, usable},
    cut::cut,
    hidden::{Hidden, with_turned_axis},
    judge::{expected, gap_m},
    number,
};

/// Twins made by `reconstruct`, whose own errors are those of their recordings, with and without a hidden
/// effect.
#[test]
#[ignore = "reconstructs; half a minute of processor time and more a twin"]
fn reconstructed_twins() {
    let (count, seed) = (number("GAP_FRAMES_TWINS", 3), number("GAP_FRAMES_SEED", 100));
    let (mut right, mut all) = (0, 0);
    for seed in seed..seed + count {
        let temp = Folder::new(&format!("gap-twins-{seed}"));
        let config = SynthConfig {
            seed,
            parts: Some(2),
            width: 320,
            height: 240,
            views: 14,
            textured: Some(true),
            ..SynthConfig::default()
        };
        let (object, config) = usable(&config, Hidden::Nothing);
        let mut command = Command::new(env!("CARGO_BIN_EXE_artitwin"));
        command.arg("reconstruct").args(["--name", "twin", "--out"]).arg(&temp.0);
        for k in 0..2 {
            let bag = temp.0.join(format!("state{k}"));
            write_synth_bag(&bag, k, &film_take(&object, k, k, &config)).unwrap();
            command.arg(bag);
        }
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let folder = temp.0.join("twin");
        let text = fs::read_to_string(folder.join("twin.urdf")).unwrap();
        for hidden in [Hidden::Nothing, Hidden::DepthScale(0.03), Hidden::AxisTurn(0.0524), Hidden::Cut(1)] {
            let urdf = folder.join("changed.urdf");
            let changed = match hidden {
                Hidden::AxisTurn(rad) => with_turned_axis(&text, rad),
                Hidden::Cut(_) => {
                    cut(
                        &folder.join("meshes/visual/part_1.obj"),
                        &folder.join("meshes/visual/part_1_cut.obj"),
                    );
                    text.replace("meshes/visual/part_1.obj", "meshes/visual/part_1_cut.obj")
                }
                _ => text.clone(),
            };
            fs::write(&urdf, changed).unwrap();
            let (summary, report) = film_and_diagnose(&temp.0, &urdf, hidden, &object, &config);
            let expected = expected(hidden, &object, &[], seed);
            let name = expected.as_ref().map(|e| e.effect);
            let [before, after, floor] = gap_m(&report).map(|x| 1e3 * x);
            let found = report["findings"][0]["effect"].as_str();
            println!(
                "{seed} {} {hidden:?}: {found:?} {before:.2} -> {after:.2} mm, noise {floor:.2} mm",
                object.family
            );
            if found != name {
                println!("{summary}");
            }
            right += usize::from(found == name);
            all += 1;
        }
    }
    println!("{right} of {all}");
    assert!(10 * right >= 9 * all, "{right} of {all} right");
}
