//! The report as one self-contained page: pictures are embedded, there is no script, and nothing is loaded.

use std::fmt::Write as _;

use rayon::prelude::*;

use super::{
    difference_report::StateDifference,
    link_report::{FileTriangles, LinkReport},
    number::{decimal, significant},
    overall::OverallWord,
    page::{self, counted_noun, number_with_unit, push_list, push_table, table_row, with_true_minus},
    picture::{Picture, PictureError, part_color},
    report_json::{JointReport, Quantity, RecordedCamera, Report, SpreadReport},
};
use model::escape_xml as escape;

/// Shown in place of a standard deviation that is no better than a guess's.
const NOT_DETERMINED: &str = "not determined";

/// Explains the colors of [`PhotoAndTwin::difference`].
const DIFFERENCE_LEGEND: &str = "Orange: a camera read the object where the twin has nothing. Violet: a \
    camera saw through where the twin is. White: edges and pixels without a reading, which say nothing.";

/// The pictures of a report.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReportPictures {
    /// A photo of every state, and beside it the twin in the same pose from the same camera.
    pub states: Vec<PhotoAndTwin>,
    /// The parts in the colors of [`part_color`], with their axes.
    pub parts: Vec<Picture>,
    /// The surface of the object that was kept.
    pub kept: Vec<Picture>,
    /// The differences between the twin and the readings, over all views.
    pub differences: Vec<StateDifference>,
}

/// A photo and the twin as the same camera would see it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PhotoAndTwin {
    /// State of the object.
    pub state: usize,
    /// Name of the view.
    pub view: String,
    /// Peak signal-to-noise ratio over the object's pixels, dB; none if these are unknown.
    pub psnr_db: Option<f64>,
    /// The photo.
    pub photo: Picture,
    /// The rendered model.
    pub twin: Picture,
    /// Differences by the measured depth; none if the object's pixels are unknown.
    pub difference: Option<Picture>,
    /// PNG of the object alone as the camera saw it, and that camera; none if the object's pixels are
    /// unknown.
    pub cutout: Option<(Vec<u8>, RecordedCamera)>,
}

/// The page of a report.
///
/// # Errors
/// If a picture cannot be encoded.
pub fn report_html(report: &Report, pictures: &ReportPictures) -> Result<String, PictureError> {
    let name = escape(&report.name);
    let mut out = page::page_head(&format!("{name}: articulated twin"), "");
    push_header(&mut out, report);
    push_warnings(&mut out, report);
    push_photos(&mut out, &pictures.states, &report.run.differences)?;
    push_joints(&mut out, report);
    push_links(&mut out, report);
    let kept: Vec<&Picture> = pictures.kept.iter().collect();
    let parts: Vec<&Picture> = pictures.parts.iter().collect();
    out.push_str("<div class=\"side\">\n");
    push_pictures(&mut out, "Parts and axes", &parts, 2, "")?;
    push_pictures(&mut out, "Kept as the object", &kept, 2, "")?;
    push_unknown(&mut out, report);
    push_times(&mut out, report);
    push_start(&mut out, report);
    push_run(&mut out, report);
    out.push_str("</div>\n");
    out.push_str(page::TAIL);
    Ok(out)
}

// Writing to a string cannot fail: the results below are dropped.

fn push_header(out: &mut String, report: &Report) {
    let class = match report.overall.word {
        OverallWord::Usable => "pill",
        OverallWord::UsableWithWarnings => "pill check",
        OverallWord::LookBeforeUse => "pill look",
    };
    let title = report.overall.title_text(report.run.warnings.len());
    let motions: Vec<String> = report.joints.iter().map(sentence).collect();
    let found = if motions.is_empty() { "no joint was found".to_owned() } else { motions.join("; ") };
    let name = escape(&report.name);
    let reason = escape(&report.overall.reason);
    let found = escape(&found);
    writeln!(
        out,
        "<header>\n<h1>{name}</h1>\n<p class=\"verdict\"><span class=\"{class}\">{title}</span>\
         {reason}.</p>\n<p class=\"found\">{found}.</p>"
    )
    .ok();
    let mut facts =
        vec![counted_noun(report.links.len(), "part"), counted_noun(report.joints.len(), "joint")];
    if !report.run.input.frames.is_empty() {
        facts.push(format!(
            "{} frames",
            report.run.input.frames.iter().map(ToString::to_string).collect::<Vec<_>>().join(" + ")
        ));
    }
    if let Some([low, high]) = report.run.object_box_m {
        let sides = [0, 1, 2].map(|k| decimal(high[k] - low[k], 2)).join(" \u{d7} ");
        facts.push(format!("object found in a box of {sides} m"));
    }
    facts.push(duration(report.total_seconds()));
    facts.push(format!("seed {}", report.run.seed));
    writeln!(out, "<p class=\"facts\">{}</p>\n</header>", escape(&facts.join(" \u{b7} "))).ok();
}

/// Motion of a joint, in words.
fn sentence(joint: &JointReport) -> String {
    let verb = if joint.motion.unit == "rad" { "turns" } else { "slides" };
    format!("{} {verb} {}", joint.child, motion(&joint.motion, &joint.motion_std))
}

fn push_warnings(out: &mut String, report: &Report) {
    // The joints' warnings are among them.
    let all: Vec<String> = report.run.warnings.iter().map(ToString::to_string).collect();
    push_list(out, "warnings", "Warnings", &all);
}

/// The photo, the twin and their differences of every shown view.
fn push_photos(
    out: &mut String,
    states: &[PhotoAndTwin],
    differences: &[StateDifference],
) -> Result<(), PictureError> {
    let all: Vec<&Picture> = states
        .iter()
        .flat_map(|s| [Some(&s.photo), Some(&s.twin), s.difference.as_ref()])
        .flatten()
        .collect();
    let (columns, legend) =
        if states.iter().all(|s| s.difference.is_some()) { (3, DIFFERENCE_LEGEND) } else { (4, "") };
    push_pictures(out, "Photos and twin, same camera", &all, columns, legend)?;
    let head = [
        "State",
        "Views",
        "Readings compared",
        "Not explained",
        "Orange: twin lacks",
        "Violet: twin too much",
    ];
    let rows: String = differences.iter().map(|d| table_row(&head, &difference_cells(d))).collect();
    push_table(out, "Where twin and photos differ", &head, &rows);
    Ok(())
}

fn difference_cells(d: &StateDifference) -> [String; 6] {
    let worst = d.views.iter().max_by(|a, b| a.share.total_cmp(&b.share));
    let worst = worst.map_or_else(String::new, |w| {
        format!("<br><span class=\"soft\">most in {}: {}</span>", escape(&w.name), percent(w.share))
    });
    let links: Vec<String> =
        d.links.iter().map(|l| format!("{} {}", escape(&l.name), percent(l.share))).collect();
    let by_part = format!("<br><span class=\"soft\">{}</span>", links.join(", "));
    [
        format!("state {}", d.state),
        d.views.len().to_string() + &worst,
        d.readings.to_string(),
        percent(d.share) + &by_part,
        percent(d.lacks),
        percent(d.surplus),
    ]
}

fn percent(share: f64) -> String {
    number_with_unit(&decimal(100.0 * share, 2), "%")
}

fn push_pictures(
    out: &mut String,
    title: &str,
    pictures: &[&Picture],
    columns: usize,
    legend: &str,
) -> Result<(), PictureError> {
    if pictures.is_empty() {
        return Ok(());
    }
    let columns = columns.min(pictures.len());
    let class = if columns == 3 { "pictures triples" } else { "pictures" };
    writeln!(out, "<section>\n<h2>{title}</h2>\n<div class=\"{class}\" style=\"--columns: {columns}\">").ok();
    for figure in pictures.par_iter().map(|picture| picture.figure_html()).collect::<Vec<_>>() {
        out.push_str(&figure?);
        out.push('\n');
    }
    let legend =
        if legend.is_empty() { String::new() } else { format!("<p class=\"legend\">{legend}</p>\n") };
    writeln!(out, "</div>\n{legend}</section>").ok();
    Ok(())
}

fn push_joints(out: &mut String, report: &Report) {
    let head = [
        "Joint",
        "Type",
        "Motion",
        "Axis in the world",
        "Axis \u{b1}",
        "Place \u{b1}",
        "Support",
        "Residual",
    ];
    let mut rows = String::new();
    for joint in &report.joints {
        let child = report.links.iter().position(|l| l.name == joint.child).unwrap_or_default();
        // A slide has a direction but no line, so it has no position perpendicular to its axis.
        let place =
            if joint.motion.unit == "rad" { spread(joint.origin_std_mm, "mm") } else { "\u{2013}".into() };
        let through = if joint.motion.unit == "rad" {
            format!("<br><span class=\"soft\">through {} m</span>", vector(joint.origin))
        } else {
            String::new()
        };
        let alone = joint.axis_alone.map_or_else(String::new, |a| {
            format!("<br><span class=\"soft\">{} by its motion alone</span>", spread(a.std_deg, "\u{b0}"))
        });
        let share = if joint.tried > 0 { 100.0 * joint.inliers as f64 / joint.tried as f64 } else { 0.0 };
        let cells = [
            format!(
                "{}{}<br><span class=\"soft\">moves {} on {}</span>",
                dot(child),
                escape(&joint.name),
                escape(&joint.child),
                escape(&joint.parent)
            ),
            escape(&joint.kind),
            escape(&motion(&joint.motion, &joint.motion_std)) + &positions(joint),
            vector(joint.axis) + &through,
            spread(joint.axis_std_deg, "\u{b0}") + &alone,
            place,
            format!("{}<br><span class=\"soft\">{share:.0} % of {}</span>", joint.inliers, joint.tried),
            number_with_unit(&decimal(joint.residual_rms_mm, 2), "mm"),
        ];
        rows.push_str(&table_row(&head, &cells));
        for caution in &joint.cautions {
            writeln!(rows, "<tr class=\"caution\"><td colspan=\"8\">{}</td></tr>", escape(&caution.text))
                .ok();
        }
    }
    push_table(out, "Joints", &head, &rows);
}

/// Unobservable parameters of each joint, and how the parts were counted.
fn push_unknown(out: &mut String, report: &Report) {
    let said =
        |j: &JointReport| j.not_observable.iter().map(|n| format!("{}: {n}", j.name)).collect::<Vec<_>>();
    push_list(
        out,
        "unknown",
        "Not observable in these states",
        &report.joints.iter().flat_map(said).collect::<Vec<_>>(),
    );
    if let Some(count) = &report.run.part_count {
        let title =
            if count.given.is_some() { "Number of parts: given" } else { "Number of parts: by evidence" };
        let (head, rows) = count.head_and_rows();
        push_table(out, title, &head, &rows);
    }
}

fn mass_text(kg: f64, range_kg: [f64; 2]) -> String {
    let [low, high] = range_kg.map(|m| significant(m, 2));
    format!(
        "{}<br><span class=\"soft\">{low} to {}</span>",
        number_with_unit(&significant(kg, 3), "kg"),
        number_with_unit(&high, "kg")
    )
}

fn triangles_text(n: usize) -> String {
    number_with_unit(&n.to_string(), if n == 1 { "triangle" } else { "triangles" })
}

fn link_cells(i: usize, link: &LinkReport) -> [String; 6] {
    let FileTriangles { visual, assumed: walls, collision } = link.file_triangles;
    let walls = if walls > 0 { format!(", {walls} of assumed walls") } else { String::new() };
    [
        format!("{}{}{}", dot(i), escape(&link.name), grasps(link)),
        format!(
            "{}<br><span class=\"soft\">of {} before decimation{walls}</span>",
            triangles_text(visual),
            link.triangles
        ),
        format!(
            "{}<br><span class=\"soft\">in {}</span>",
            triangles_text(collision),
            counted_noun(link.solids, "convex solid")
        ),
        number_with_unit(&decimal(link.area_m2, 3), "m\u{b2}") + &assumed(link),
        mass_text(link.mass_kg, link.mass_range_kg),
        format!("<span class=\"soft\">{}</span>", escape(&link.assumption)),
    ]
}

fn push_links(out: &mut String, report: &Report) {
    let head = ["Part", "Visual mesh", "Collision", "Area", "Mass (assumed)", "Rests on"];
    let mut rows: String =
        report.links.iter().enumerate().map(|(i, link)| table_row(&head, &link_cells(i, link))).collect();
    if report.links.len() > 1 {
        let all = |of: fn(&LinkReport) -> usize| report.links.iter().map(of).sum::<usize>();
        let sum = |of: fn(&LinkReport) -> f64| report.links.iter().map(of).sum::<f64>();
        let cells = [
            "All parts".to_owned(),
            triangles_text(all(|l| l.file_triangles.visual + l.file_triangles.assumed)),
            triangles_text(all(|l| l.file_triangles.collision)),
            number_with_unit(&decimal(sum(|l| l.area_m2), 3), "m\u{b2}"),
            mass_text(sum(|l| l.mass_kg), [sum(|l| l.mass_range_kg[0]), sum(|l| l.mass_range_kg[1])]),
            String::new(),
        ];
        rows.push_str(&table_row(&head, &cells));
    }
    push_table(out, "Parts and their files", &head, &rows);
}

/// Where a gripper can hold a link, for the cell with its name.
fn grasps(link: &LinkReport) -> String {
    let widths: Vec<String> = link.grasps.iter().map(|g| decimal(g.width_mm, 0)).collect();
    match widths.split_last() {
        None => String::new(),
        Some((last, others)) => {
            let and = if others.is_empty() { String::new() } else { format!("{} and ", others.join(", ")) };
            let places = counted_noun(widths.len(), "place");
            format!("<br><span class=\"soft\">{places} to grasp, {and}{last} mm wide</span>")
        }
    }
}

/// How much of a link's surface no view saw, for the cell with its area.
fn assumed(link: &LinkReport) -> String {
    let share = link.assumed_area_m2 / link.area_m2;
    if share > 0.0 {
        format!("<br><span class=\"soft\">{} % of it closed holes</span>", significant(100.0 * share, 2))
    } else {
        String::new()
    }
}

fn push_times(out: &mut String, report: &Report) {
    let longest = report.run.stages.iter().map(|s| s.seconds).fold(0.0, f64::max);
    if longest <= 0.0 {
        return;
    }
    out.push_str("<section>\n<h2>Where the time went</h2>\n<div class=\"bars\">\n");
    for stage in &report.run.stages {
        let share = decimal(100.0 * stage.seconds / longest, 1);
        let name = escape(&stage.name);
        let time = duration(stage.seconds);
        writeln!(
            out,
            "<span>{name}</span><div class=\"bar\" style=\"width: {share}%\"></div><span \
            class=\"number\">{time}</span>"
        )
        .ok();
    }
    out.push_str("</div>\n</section>\n");
}

fn motion_text(rotation_deg: f64, displacement_mm: f64) -> String {
    let displacement = number_with_unit(&decimal(displacement_mm, 2), "mm");
    format!("{} / {displacement}", number_with_unit(&decimal(rotation_deg, 3), "\u{b0}"))
}

fn push_start(out: &mut String, report: &Report) {
    let head = ["Joint", "Started from", "Start turns / moves part by", "Result differs by"];
    let mut rows = String::new();
    for m in &report.run.initialization {
        let source = if m.used { escape(&m.source) } else { format!("not used: {}", escape(&m.source)) };
        let start = motion_text(m.start_rotation_deg, m.start_displacement_mm);
        let change = motion_text(m.rotation_deg, m.displacement_mm);
        rows.push_str(&table_row(&head, &[escape(&m.joint), source, start, change]));
    }
    push_table(out, "From the start to the result", &head, &rows);
}

fn push_run(out: &mut String, report: &Report) {
    let run = &report.run;
    let mut entries: Vec<(&str, String)> = Vec::new();
    entries.extend(run.input.paths.iter().map(|p| ("Input", p.clone())));
    entries.extend([
        ("Preset", run.preset.clone()),
        ("Device", run.device.clone()),
        ("Configuration", run.config_digest.clone()),
    ]);
    entries.extend(run.versions.iter().map(|(name, version)| (name.as_str(), version.clone())));
    entries.extend(run.notes.iter().map(|n| ("Note", n.text.clone())));
    let items = entries.iter().filter(|(_, text)| !text.is_empty());
    let items: String =
        items.map(|(name, text)| format!("<dt>{}</dt><dd>{}</dd>\n", escape(name), escape(text))).collect();
    writeln!(out, "<section>\n<h2>Run</h2>\n<dl>\n{items}</dl>\n</section>").ok();
}

/// A motion with its standard deviation in degrees or millimeters.
fn motion(value: &Quantity, std: &SpreadReport) -> String {
    let (factor, unit) =
        if value.unit == "rad" { (180.0 / std::f64::consts::PI, "\u{b0}") } else { (1000.0, " mm") };
    let spread = match std.value {
        // At least one in the last digit: "± 0" would claim certainty.
        Some(std) => format!("\u{b1} {}{unit}", decimal((factor * std).max(0.01), 2)),
        None => format!("(deviation {NOT_DETERMINED})"),
    };
    with_true_minus(&format!("{:+.2}{unit} {spread}", factor * value.value))
}

/// A standard deviation with its unit, or words if there is none.
fn spread(value: Option<f64>, its_unit: &str) -> String {
    value.map_or_else(|| NOT_DETERMINED.to_owned(), |v| number_with_unit(&significant(v, 2), its_unit))
}

/// Where the joint is closed, and its positions in all states if there are more than two.
fn positions(joint: &JointReport) -> String {
    let (factor, unit) =
        if joint.motion.unit == "rad" { (180.0 / std::f64::consts::PI, "\u{b0}") } else { (1000.0, " mm") };
    let closed = joint.limit.closed.as_ref().map(|seat| {
        format!(
            "<br><span class=\"soft\">closed at {}{unit}, where {:.0} % of the face meets its seat</span>",
            with_true_minus(&decimal(factor * seat.position, 2)),
            100.0 * seat.contact_share
        )
    });
    let closed = closed.unwrap_or_default();
    let all: Vec<String> =
        joint.positions.iter().map(|p| with_true_minus(&decimal(factor * p.value, 2))).collect();
    // With two states, the motion already says this.
    if all.len() < 3 {
        return closed;
    }
    let [lower, upper] = joint.limit.observed_in;
    format!(
        "{closed}<br><span class=\"soft\">in the states at {}{unit}; limits seen in states {lower} and \
         {upper}</span>",
        escape(&all.join(", "))
    )
}

/// Three coordinates as text.
fn vector(v: [f64; 3]) -> String {
    with_true_minus(&format!("({})", v.map(|x| decimal(x, 3)).join(", ")))
}

fn dot(part: usize) -> String {
    let [r, g, b] = part_color(part);
    format!("<span class=\"dot\" style=\"background: rgb({r} {g} {b})\"></span>")
}

fn duration(seconds: f64) -> String {
    match seconds {
        // The bounds are where the shorter form would round up to one more digit.
        s if s < 9.95 => format!("{s:.1} s"),
        s if s < 119.5 => format!("{s:.0} s"),
        s => format!("{:.0} min {:02.0} s", (s.round() / 60.0).floor(), s.round() % 60.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::overall::Overall;
    use crate::{InitialMotion, InputFacts, PictureKind, RunFacts, StageTime, limit_report::SeatReport};
    use common::note::{Note, NoteCode};
    use model::example::cabinet;

    fn picture(caption: &str) -> Picture {
        Picture {
            width: 8,
            height: 6,
            rgb: vec![90; 144],
            caption: caption.into(),
            kind: PictureKind::Drawing,
            arrows: vec![],
        }
    }

    fn page(edit: impl FnOnce(&mut Report, &mut ReportPictures)) -> String {
        let run = RunFacts {
            input: InputFacts { paths: vec!["bags/cabinet".into()], frames: vec![30, 28] },
            stages: vec![
                StageTime { name: "field/state0".into(), seconds: 124.0 },
                StageTime { name: "export".into(), seconds: 1.5 },
            ],
            initialization: vec![InitialMotion {
                joint: "door_hinge".into(),
                source: "registration".into(),
                used: true,
                start_rotation_deg: 71.4,
                start_displacement_mm: 250.0,
                rotation_deg: 0.25,
                displacement_mm: 1.5,
            }],
            seed: 7,
            ..RunFacts::default()
        };
        let mut report = Report::new(&cabinet(), &[], run);
        let mut pictures = ReportPictures {
            states: vec![PhotoAndTwin {
                photo: picture("photo"),
                twin: picture("twin"),
                ..PhotoAndTwin::default()
            }],
            parts: vec![picture("parts")],
            kept: vec![picture("kept")],
            ..ReportPictures::default()
        };
        edit(&mut report, &mut pictures);
        report_html(&report, &pictures).unwrap()
    }

    #[test]
    fn the_closed_end_and_the_objects_box_are_given() {
        let html = page(|report, _| {
            report.run.object_box_m = Some([[0.0, -0.25, 0.0], [0.4, 0.25, 0.6]]);
            report.joints[1].limit.closed =
                Some(SeatReport { position: -0.03, std: 0.001, contact_share: 0.12 });
        });
        for text in [
            "object found in a box of 0.4 \u{d7} 0.5 \u{d7} 0.6 m",
            "closed at \u{2212}30 mm, where 12 % of the face meets its seat",
        ] {
            assert!(html.contains(text), "'{text}' is not in {html}");
        }
        assert!(!page(|_, _| {}).contains("closed at"));
    }

    #[test]
    fn the_page_says_what_was_found_and_loads_nothing() {
        let html = page(|_, _| {});
        for text in [
            ">Usable</span>nothing speaks against the joints.",
            "door turns +71.62\u{b0} \u{b1} 0.01\u{b0}; drawer slides \u{2212}180.00 mm \u{b1} 0.1 mm.",
            "3 parts \u{b7} 2 joints \u{b7} 30 + 28 frames \u{b7} 2 min 06 s \u{b7} seed 7",
            "90 % of 1000",
            "style=\"width: 100%\"",
            "0.25<span class=\"unit\">\u{b0}</span>",
        ] {
            assert!(html.contains(text), "'{text}' is not in {html}");
        }
        assert_eq!(html.matches("src=\"data:image/png;base64,").count(), 4);
        assert_eq!(html.matches("src=").count(), 4);
        for loaded in ["http:", "https:", "<script", "<link", "@import", "url("] {
            assert!(!html.contains(loaded), "{loaded}");
        }
    }

    #[test]
    fn warnings_and_cautions_come_first() {
        let html = page(|report, _| {
            let caution = Note::new(NoteCode::JointContradicted, "little support");
            report.run.warnings.push(Note::new(NoteCode::PosesMissing, "2 frames had no pose"));
            report.run.warnings.push(caution.about("door_hinge"));
            report.joints[0].cautions.push(caution);
            report.overall = Overall::of_run(2, &report.run.warnings, &[]);
        });
        assert!(
            html.contains(">Look before use</span>door_hinge: little support.")
                && html.contains("<li>door_hinge: little support</li>")
        );
        assert!(html.find("2 frames had no pose") < html.find("<img"));
    }

    #[test]
    fn text_cannot_become_markup() {
        let html = page(|report, pictures| {
            report.name = "<script>alert(1)</script>".into();
            report.run.notes.push(Note::new(NoteCode::TopicsChosen, "a < b & c"));
            pictures.kept[0].caption = "\"><script>".into();
        });
        assert!(!html.contains("<script") && html.contains("a &lt; b &amp; c"));
    }

    #[test]
    fn every_element_is_closed() {
        let html = page(|report, _| report.run.warnings.push(Note::new(NoteCode::PosesMissing, "x")));
        for tag in [
            "section", "div", "table", "tr", "td", "figure", "h2", "ul", "li", "dl", "dd", "span", "main",
            "header",
        ] {
            let open = html.matches(&format!("<{tag}>")).count() + html.matches(&format!("<{tag} ")).count();
            assert_eq!(open, html.matches(&format!("</{tag}>")).count(), "{tag}");
        }
    }

    #[test]
    fn durations_are_readable() {
        for (seconds, text) in [
            (0.04, "0.0 s"),
            (9.94, "9.9 s"),
            (59.6, "60 s"),
            (119.4, "119 s"),
            (119.6, "2 min 00 s"),
            (3671.0, "61 min 11 s"),
        ] {
            assert_eq!(duration(seconds), text);
        }
    }
}
