//! Calibration.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "a test may panic")]
use artitwin::internal::{
    config::Config,
    export::{LookConfig, looks},
    geometry::Pose,
    io,
    model::ArticulatedModel,
    run::{Monitor, Stages, compare, reconstruct_twin},
};
#[test]
fn calibrate() {
    let Ok(bags) = std::env::var("BAGS") else { return };
    for bag in bags.split(',') {
        let config = Config::default();
        let mut capture = io::open(&[bag.into()], &config.capture, 0).unwrap();
        let monitor = Monitor::silent();
        let Ok(twin) = reconstruct_twin("object", &mut capture, None, &config, &mut Stages::new(&monitor))
        else {
            eprintln!("{bag} FAILED");
            continue;
        };
        let looks = looks(&twin.model, &capture, &LookConfig::default());
        let show = |what: &str, model: &ArticulatedModel, looks: &[_]| {
            let start = std::time::Instant::now();
            for s in compare(&capture, model, looks) {
                let worst = s.views.iter().map(|v| v.share).fold(0.0, f64::max);
                let links: Vec<String> = s.links.iter().map(|l| format!("{:.1}", 100.0 * l.share)).collect();
                eprintln!(
                    "{bag} | {what} | s{} share {:.2} lacks {:.2} surplus {:.2} worst {:.1} links {:?}",
                    s.state,
                    100.0 * s.share,
                    100.0 * s.lacks,
                    100.0 * s.surplus,
                    100.0 * worst,
                    links
                );
            }
            if what == "clean" {
                eprintln!("{:.2} s", start.elapsed().as_secs_f64());
            }
        };
        show("clean", &twin.model, &looks);
        for j in 0..twin.model.joints.len() {
            let turns = twin.model.joints[j].kind.turns();
            for by in [0.5, 1.0, 2.0, 4.0] {
                let mut model = twin.model.clone();
                model.states[1][j] += if turns { f64::to_radians(by) } else { 0.0025 * by };
                show(&format!("joint {j} off by {by} (deg, 2.5 mm)"), &model, &looks);
            }
            let mut model = twin.model.clone();
            let joint = &mut model.joints[j];
            joint.parent_from_joint *= Pose::translation(0.01, 0.01, 0.01);
            show(&format!("joint {j} 17 mm off"), &model, &looks);
            let mut without = looks.clone();
            without[twin.model.joints[j].child].mesh = Default::default();
            show(&format!("part {j} missing"), &twin.model, &without);
        }
    }
}
