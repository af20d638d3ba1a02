//! Names that no writer may take for markup: what is written parses, and is read back as it was.

use proptest::prelude::*;

use super::{
    drawn::{drawn_meshes, plain_looks},
    mjcf::mjcf,
    sdf::sdf,
    urdf::{ros_urdf, urdf},
    viewer::viewer_html,
    *,
};
use gap::{model::effects::catalogue, twin_tree::TwinTree};
use io::twin_of;
use model::{ArticulatedModel, escape_xml, example::cabinet, is_xml_text, validate};

/// What would be a joint, were it not escaped.
const INJECTED: &str = "j\"/><joint name=\"injected\" type=\"slide";

/// Texts that XML can hold, with what may break a writer more often than chance has it.
fn name() -> impl Strategy<Value = String> {
    let odd = prop::sample::select(vec![
        INJECTED,
        "<",
        "&",
        "\"",
        "'",
        "]]>",
        "-->",
        "</script>",
        "\n",
        "\t",
        "\r",
        "@DATA@",
        "{}",
        "${x}",
        "\\",
    ]);
    let piece = prop_oneof![odd.prop_map(str::to_owned), any::<String>()];
    prop::collection::vec(piece, 1..4)
        .prop_map(|p| p.concat())
        .prop_filter("what XML has no form for", |t| is_xml_text(t))
}

/// The cabinet with other names; numbers before them keep them apart.
fn renamed(name: &str) -> ArticulatedModel {
    let mut model = cabinet();
    model.name = format!("m{name}");
    model.links.iter_mut().enumerate().for_each(|(i, l)| l.name = format!("l{i}{name}"));
    model.joints.iter_mut().enumerate().for_each(|(i, j)| j.name = format!("j{i}{name}"));
    model
}

/// Names of the elements with a tag, each once.
fn names(text: &str, tag: &str) -> Vec<String> {
    let document = roxmltree::Document::parse(text).unwrap_or_else(|e| panic!("{e}: {text}"));
    let all = document.descendants().filter(|n| n.has_tag_name(tag)).filter_map(|n| n.attribute("name"));
    let mut all: Vec<String> = all.map(str::to_owned).collect();
    all.sort();
    all
}

fn sorted<'a>(names: impl Iterator<Item = &'a String>) -> Vec<String> {
    let mut all: Vec<String> = names.cloned().collect();
    all.sort();
    all
}

fn twin(name: &str) -> TwinTree {
    let [r, a, b, j] = ["r", "a", "b", "j"].map(|front| escape_xml(&format!("{front}{name}")));
    let inertial =
        "<inertial><mass value='1'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/></inertial>";
    let joint = format!(
        "<joint name='{j}' type='continuous'><parent link='{a}'/><child link='{b}'/><axis xyz='0 0 \
         1'/></joint>"
    );
    twin_of(
        &format!("<robot name='{r}'><link name='{a}'/><link name='{b}'>{inertial}</link>{joint}</robot>"),
        [0.0; 3],
    )
    .unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn names_in_xml_are_read_back(name in name()) {
        let model = renamed(&name);
        let links = sorted(model.links.iter().map(|l| &l.name));
        let joints = sorted(model.joints.iter().map(|j| &j.name));
        for text in [urdf(&model, UrdfScrew::Nearest), ros_urdf(&model, UrdfScrew::Nearest)] {
            prop_assert_eq!((names(&text, "link"), names(&text, "joint")), (links.clone(), joints.clone()));
        }
        let text = mjcf(&model, &ExportConfig::default());
        prop_assert_eq!((names(&text, "body"), names(&text, "joint")), (links.clone(), joints.clone()));
        let text = sdf(&model, &ExportConfig::default());
        prop_assert_eq!(names(&text, "link"), links);
        prop_assert_eq!(names(&text, "joint").len(), joints.len() + 1);
        let config = ExportConfig::default();
        let texts = [
            super::sdf::model_config(&model, &config),
            super::ros_package::package_xml(&model, &config),
        ];
        for text in texts {
            let document = roxmltree::Document::parse(&text).unwrap();
            let written = document.descendants().find(|n| n.has_tag_name("name")).and_then(|n| n.text());
            prop_assert_eq!(written, Some(model.name.as_str()));
        }
    }

    #[test]
    fn a_screw_as_a_pair_keeps_its_names(name in name()) {
        let mut model = renamed(&name);
        model.joints[1].kind = model::JointKind::Screw { pitch_m_per_rad: 0.01 };
        let text = urdf(&model, UrdfScrew::Pair);
        let advance = format!("{}_advance", model.joints[1].name);
        prop_assert!(names(&text, "joint").contains(&advance));
        let document = roxmltree::Document::parse(&text).unwrap();
        let ends = document.descendants().filter(|n| n.has_tag_name("parent") || n.has_tag_name("child"));
        let links = names(&text, "link");
        for end in ends {
            prop_assert!(links.iter().any(|l| end.attribute("link") == Some(l)));
        }
        names(&mjcf(&model, &ExportConfig::default()), "body");
    }

    #[test]
    fn names_in_the_mjcf_of_a_diagnosis_are_read_back(name in name()) {
        let tree = twin(&name);
        let (text, _) = crate::diagnosed::mjcf::mjcf(&tree, &[], &catalogue(0), "twin.xml");
        prop_assert_eq!(names(&text, "joint"), [tree.joints[0].name.clone()]);
        prop_assert_eq!(names(&text, "general"), [tree.joints[0].name.clone()]);
        prop_assert_eq!(names(&text, "body"), [tree.links[1].name.clone()]);
        let document = roxmltree::Document::parse(&text).unwrap();
        prop_assert_eq!(document.root_element().attribute("model"), Some(tree.name.as_str()));
    }

    #[test]
    fn pages_hold_a_name_as_text(name in name()) {
        let model = renamed(&name);
        let page = viewer_html(&model, &drawn_meshes(&model, &plain_looks(&model)));
        prop_assert_eq!(page.matches("</script>").count(), 2);
        let json = page.split_once("application/json\">").unwrap().1.split_once("</script>").unwrap().0;
        let data: serde_json::Value = serde_json::from_str(json).unwrap();
        prop_assert_eq!(data["joints"][0]["name"].as_str(), Some(model.joints[0].name.as_str()));
        let title = page.split_once("<title>").unwrap().1.split_once("</title>").unwrap().0;
        prop_assert_eq!(title, escape_xml(&model.name));
        let page = |model: &ArticulatedModel| {
            report_html(&Report::new(model, &[], RunFacts::default()), &ReportPictures::default()).unwrap()
        };
        let html = page(&model);
        let plain = page(&cabinet());
        prop_assert_eq!(html.matches('<').count(), plain.matches('<').count());
    }

    #[test]
    fn where_names_are_identifiers_no_other_is_written(name in name()) {
        let model = renamed(&name);
        prop_assume!(!model::is_plain_name(&model.name));
        // Nothing with such a name is exported; were it, it would be a name all the same.
        prop_assert!(!validate(&model).is_empty());
        let plain = |n: &str| !n.is_empty() && n.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
        let looks = plain_looks(&model);
        let text = usda(&model, &drawn_meshes(&model, &looks), Base::Fixed);
        let prims: Vec<&str> = text.lines().filter_map(|l| l.trim_start().strip_prefix("def ")).collect();
        let is_definition = |line: &&str| line.trim_start().starts_with("def ");
        let plainly = usda(&cabinet(), &drawn_meshes(&cabinet(), &looks), Base::Fixed);
        let expected = plainly.lines().filter(is_definition).count();
        prop_assert_eq!(prims.len(), expected);
        for prim in prims {
            prop_assert!(plain(prim.split('"').nth(1).unwrap()), "{}", prim);
        }
        let cmake = super::ros_package::cmake_lists(&model, ["model.sdf"].into_iter());
        let project = cmake.split_once("project(").unwrap().1.split_once(")\n").unwrap().0;
        prop_assert!(plain(project), "{}", cmake);
    }
}

#[test]
fn no_name_leads_out_of_the_folder() {
    let model = renamed("/../../x");
    for file in package(&model, &plain_looks(&model), &ExportConfig::default()) {
        let plain = file.path.chars().all(|c| c.is_ascii_alphanumeric() || "_./".contains(c));
        assert!(plain && !file.path.contains(".."), "{}", file.path);
    }
}
