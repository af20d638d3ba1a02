//! Missing geometry as a finding.

use crate::{
    camera::{
        judge::finding::{CameraFinding, Subject},
        model::{missing::Missing, twin::SeenTwin},
    },
    judge::finding::{Finding, ParameterEstimate},
};

/// Index in reports, after the catalogue's effects.
const INDEX: usize = 101;

/// The finding for a region of missing geometry.
pub fn missing_finding(missing: &Missing, twin: &SeenTwin) -> CameraFinding {
    let mut parameters = vec![ParameterEstimate {
        name: "area".into(),
        value: missing.area_m2,
        unit: "m^2".into(),
        interval: missing.area_interval,
        open: None,
    }];
    for (s, name) in ["lower", "upper"].iter().enumerate() {
        for (k, axis) in ["x", "y", "z"].iter().enumerate() {
            parameters.push(ParameterEstimate {
                name: format!("{name}_{axis}"),
                value: missing.bounds[s][k],
                unit: "m".into(),
                interval: missing.bounds_interval[s][k],
                open: None,
            });
        }
    }
    // A reconstruction may lack geometry never seen: the frames do not distinguish the two.
    let reconstructed = !twin.own.is_exact();
    let alternatives = if reconstructed {
        vec![("geometry that the reconstruction itself lacks".to_owned(), 0.5)]
    } else {
        Vec::new()
    };
    let finding = Finding {
        index: INDEX,
        effect: "missing_geometry".into(),
        parameters,
        weight: if reconstructed { 0.5 } else { 1.0 },
        alternatives,
        experiment: "film the place from nearby and from all sides".into(),
        is_sure: true,
    };
    CameraFinding {
        subject: twin.parts[missing.part].joint.map_or(Subject::Root, Subject::Joint),
        finding,
        types: None,
        in_urdf: "not expressible",
    }
}
