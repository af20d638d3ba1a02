//! Places to grasp in all files: the same names and poses.

use nalgebra::{UnitQuaternion, Vector3};

use super::{
    Base, ExportConfig, Report, ReportPictures, RunFacts, UrdfScrew,
    drawn::{drawn_meshes, plain_looks},
    mjcf::mjcf,
    report_html,
    sdf::sdf,
    urdf::{ros_urdf, urdf},
    usda,
    xacro::macros_text,
};
use geometry::Pose;
use model::{ArticulatedModel, Grasp, PartNames, example::cabinet, renamed_model};

/// The cabinet with two places on its door, all names behind a prefix.
fn twin() -> ArticulatedModel {
    let grasp = |y: f64, width_m: f64| Grasp {
        link_from_grasp: Pose::from_parts(
            Vector3::new(0.05, y, 0.0).into(),
            UnitQuaternion::from_euler_angles(0.0, -std::f64::consts::FRAC_PI_2, 0.0),
        ),
        width_m,
        off_rad: 0.1,
        is_seen: true,
    };
    let mut model = cabinet();
    model.links[1].grasps = vec![grasp(0.25, 0.0142), grasp(0.2, 0.032)];
    renamed_model(model, PartNames::Numbered, "left_")
}

const NAMES: [&str; 2] = ["left_door_grasp_1", "left_door_grasp_2"];

/// Names and another attribute of the elements with a tag.
fn all<'a>(document: &'a roxmltree::Document, tag: &str, other: &str) -> Vec<(&'a str, &'a str)> {
    let of = |n: roxmltree::Node<'a, 'a>| Some((n.attribute("name")?, n.attribute(other).unwrap_or("")));
    document.descendants().filter(|n| n.has_tag_name(tag)).filter_map(of).collect()
}

#[test]
fn mjcf_has_sites_and_sdf_frames_on_the_part() {
    let model = twin();
    let config = ExportConfig { prefix: "left_".into(), ..ExportConfig::default() };
    let text = mjcf(&model, &config);
    let document = roxmltree::Document::parse(&text).unwrap();
    assert_eq!(all(&document, "site", "group"), NAMES.map(|n| (n, "4")));
    let site = document.descendants().find(|n| n.has_tag_name("site")).unwrap();
    assert_eq!(site.parent().unwrap().attribute("name"), Some("left_door"));
    assert!(site.attribute("pos") == Some("0.05 0.25 0") && site.attribute("quat").is_some(), "{text}");
    let text = sdf(&model, &config);
    let document = roxmltree::Document::parse(&text).unwrap();
    assert_eq!(all(&document, "frame", "attached_to"), NAMES.map(|n| (n, "left_door")));
    assert!(text.contains("<pose>0.05 0.25 0 0 -1.570796"), "{text}");
}

#[test]
fn usd_has_a_bare_prim_below_the_part() {
    let model = twin();
    let text = usda(&model, &drawn_meshes(&model, &plain_looks(&model)), Base::Fixed);
    for name in NAMES {
        let prim = text.split_once(&format!("        def Xform \"{name}\"\n        {{\n")).unwrap().1;
        let prim = prim.split_once('}').unwrap().0;
        assert!(prim.contains("xformOp:translate = (0.05, ") && prim.contains("xformOpOrder"), "{prim}");
    }
    assert_eq!(text.matches("PhysicsRigidBodyAPI").count(), 3);
    assert_eq!(text.matches('{').count(), text.matches('}').count());
}

#[test]
fn of_the_urdfs_the_macro_alone_has_frames() {
    let model = twin();
    for text in [urdf(&model, UrdfScrew::Pair), ros_urdf(&model, UrdfScrew::Pair)] {
        assert!(!text.contains("grasp"), "{text}");
    }
    let text = macros_text(&model, UrdfScrew::Pair);
    let document = roxmltree::Document::parse(&text).unwrap();
    for name in NAMES.map(|n| format!("${{prefix}}{n}")) {
        let link = document.descendants().find(|n| n.attribute("name") == Some(&name)).unwrap();
        assert!(link.has_tag_name("link") && !link.has_children());
        let joint = document.descendants().find(|n| n.attribute("link") == Some(&name)).unwrap();
        let joint = joint.parent().unwrap();
        let parent = joint.children().find(|n| n.has_tag_name("parent")).unwrap();
        assert_eq!(joint.attribute("type"), Some("fixed"));
        assert_eq!(parent.attribute("link"), Some("${prefix}left_door"));
    }
}

#[test]
fn the_report_lists_them() {
    let report = Report::new(&twin(), &[], RunFacts::default());
    let json: serde_json::Value = serde_json::from_str(&report.to_json()).unwrap();
    let first = &json["links"][1]["grasps"][0];
    assert_eq!((&first["name"], &first["width_mm"]), (&NAMES[0].into(), &14.2.into()));
    assert_eq!((&first["position"][1], &first["seen"]), (&0.25.into(), &true.into()));
    assert_eq!(first["quaternion"].as_array().map(Vec::len), Some(4));
    let html = report_html(&report, &ReportPictures::default()).unwrap();
    assert_eq!(html.matches("2 places to grasp, 14 and 32 mm wide").count(), 1);
    assert_eq!(html.matches("to grasp").count(), 1);
}
