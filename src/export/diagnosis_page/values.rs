//! Tables of values as twin + found = updated, and of the gap before and after.

use std::fmt::Write as _;

use super::words::{decimal_places, escaped_words, fixed_text, residual_text, unit_text, with_unit};
use gap::{
    judge::{
        finding::{Finding, ParameterEstimate},
        proof::{Gap, left_of},
        report::JointReport,
    },
    model::joint_model::Catalogue,
};
use model::escape_xml;

/// Multiple of the noise up to which there is no gap. derived: the bound of the verdict
/// (`gap::judge::assess`)
const AT_NOISE: f64 = 1.5;

/// A parameter's value in the twin, as found, and in the updated twin.
struct Value {
    /// Twin, sign between, found, updated, as text.
    parts: Option<[String; 4]>,
    /// The found value, if the twin has none.
    alone: String,
    interval: String,
    unit: String,
}

fn parameter_value(
    joint: &JointReport,
    finding: &Finding,
    p: &ParameterEstimate,
    catalogue: &Catalogue,
) -> Value {
    let effect = &catalogue[finding.index];
    let index = effect.parameters().iter().position(|own| own.name == p.name);
    let neutral = index.and_then(|i| effect.parameters()[i].neutral);
    // A twin has no value for a single event.
    let own = index.filter(|_| neutral.is_some() && !effect.is_of_one_run());
    let twin = own.map_or(0.0, |i| effect.in_twin(i, &joint.diagnosis.model.plant));
    let is_factor = own.is_some() && neutral == Some(1.0);
    let with = |x: f64| if is_factor { twin * x } else { twin + x };
    let half = 0.5 * (p.interval.1 - p.interval.0);
    let digits = decimal_places(p.value, half);
    let text = |x: f64| fixed_text(x, digits);
    let (sign, found) = match (is_factor, p.value < 0.0) {
        (true, _) => ("\u{d7}", p.value),
        (false, true) => ("\u{2212}", -p.value),
        (false, false) => ("+", p.value),
    };
    Value {
        parts: own.map(|_| [text(twin), sign.to_owned(), text(found), text(with(p.value))]),
        alone: text(p.value),
        interval: match p.open {
            Some(_) => "not determined".to_owned(),
            None => format!("{} to {}", text(with(p.interval.0)), text(with(p.interval.1))),
        },
        unit: unit_text(&p.unit),
    }
}

/// An effect's values in a sentence: `twin + found = updated unit`; the shape is in the table.
pub(super) fn values_sentence(joint: &JointReport, finding: &Finding, catalogue: &Catalogue) -> String {
    let mut all: Vec<String> = Vec::new();
    for p in &finding.parameters {
        if let Some([twin, sign, found, sum]) = parameter_value(joint, finding, p, catalogue).parts {
            all.push(with_unit(&format!("{twin} {sign} {found} = {sum}"), &p.unit));
        }
    }
    if let (true, Some(p)) = (all.is_empty(), finding.parameters.first()) {
        all.push(with_unit(&parameter_value(joint, finding, p, catalogue).alone, &p.unit));
    }
    format!("{} {}", escaped_words(&finding.effect), all.join(" and "))
}

/// The table of values.
pub(super) fn values_table(
    joint: &JointReport,
    findings: &[Finding],
    title: &str,
    catalogue: &Catalogue,
) -> String {
    let mut rows = String::new();
    for finding in findings {
        for (i, p) in finding.parameters.iter().enumerate() {
            let v = parameter_value(joint, finding, p, catalogue);
            let name = if i == 0 { escaped_words(&finding.effect) } else { String::new() };
            let equation = match v.parts {
                Some([twin, sign, found, sum]) => format!(
                    "<td class=\"sum\">{twin}</td><td>{sign}</td><td class=\"sum\">{found}</td><td>=</td><td \
                     class=\"sum\"><b>{sum}</b></td>"
                ),
                None => format!(
                    "<td class=\"sum\">\u{2013}</td><td></td><td class=\"sum\">{0}</td><td></td><td \
                     class=\"sum\"><b>{0}</b></td>",
                    v.alone
                ),
            };
            let parameter = escaped_words(&p.name);
            let unit = v.unit;
            let interval = v.interval;
            writeln!(
                rows,
                "<tr><td>{name}</td><td>{parameter}</td>{equation}<td class=\"unit\">{unit}</td><td \
                 class=\"number\">{interval}</td></tr>"
            )
            .ok();
        }
    }
    if rows.is_empty() {
        return String::new();
    }
    format!(
        "<section>\n<h3>{title}</h3>\n<div class=\"scroll\"><table \
         class=\"values\">\n<tr><th>Effect</th><th>Value</th><th \
         class=\"sum\">Twin</th><th></th><th class=\"sum\">Found</th><th></th><th \
         class=\"sum\">Updated</th><th>Unit</th><th>Updated, 95\u{a0}% \
         interval</th></tr>\n{rows}</table></div>\n</section>\n"
    )
}

/// The residuals of held-out runs under the twin and, if given, the updated twin or the nearest explanation.
pub(super) fn gap_table(joint: &JointReport, gap: &Gap, updated: Option<&str>) -> String {
    let mut rows = String::new();
    for run in &gap.runs {
        let residuals = [run.before, run.after].map(|x| residual_text(x, joint.gap_unit()));
        let whole = [run.full_before, run.full_after].map(|x| residual_text(x, joint.gap_unit()));
        let closed = updated.map(|_| closed_share(run.before, run.after, gap.noise_floor));
        let whole = (!joint.is_imposed).then_some(whole);
        push_gap_row(&mut rows, &escape_xml(&run.run), residuals, closed, whole);
    }
    if gap.runs.len() > 1 {
        let residuals = [gap.before, gap.after].map(|x| residual_text(x, joint.gap_unit()));
        let closed = updated.map(|_| closed_share(gap.before, gap.after, gap.noise_floor));
        let whole = (!joint.is_imposed).then(<[String; 2]>::default);
        push_gap_row(&mut rows, "all", residuals, closed, whole);
    }
    let most = gap.before.max(gap.after).max(gap.noise_floor).max(1e-300);
    let mut bars = String::new();
    for (name, x, class) in [
        (Some("twin"), gap.before, "twin-bar"),
        (updated, gap.after, "updated-bar"),
        (Some("noise floor"), gap.noise_floor, "noise-bar"),
    ] {
        let Some(name) = name else { continue };
        writeln!(
            bars,
            "<span>{name}</span><div class=\"bar {class}\" style=\"width: {}%\"></div><span \
             class=\"number\">{}</span>",
            fixed_text(100.0 * x / most, 1),
            residual_text(x, joint.gap_unit())
        )
        .ok();
    }
    let mut head = vec!["Held-out run".to_owned(), "Twin".to_owned()];
    head.extend(updated.into_iter().flat_map(|name| [with_capital(name), "Closed".to_owned()]));
    if !joint.is_imposed {
        head.push("Whole run: twin".to_owned());
        head.extend(updated.map(|name| format!("Whole run: {name}")));
    }
    let head: String = head.iter().map(|h| format!("<th>{h}</th>")).collect();
    let what = if joint.is_imposed {
        "The motion was imposed: residuals are those of the efforts, given the motion; closed: of what is \
         more than noise."
    } else {
        "By windows; closed: of what is more than noise. A whole run is predicted from its first state."
    };
    format!(
        "<section>\n<h3>Gap on held-out runs, root mean square of the residuals</h3>\n<div \
         class=\"bars\">\n{bars}</div>\n<div \
         class=\"scroll\"><table>\n<tr>{head}</tr>\n{rows}</table></div>\n<p class=\"soft\">{what}</p>\n\
         </section>\n"
    )
}

/// Share of the gap that the updated twin closes, as text; a dash if the twin is within its noise.
fn closed_share(before: f64, after: f64, noise_floor: f64) -> String {
    if before <= AT_NOISE * noise_floor {
        return "\u{2013}".to_owned();
    }
    let share = 1.0 - left_of(before, after, noise_floor);
    format!("{}\u{a0}%", fixed_text(100.0 * share, 0))
}

/// A row of the table of gaps: residuals of the twin and of the updated twin, and those of the whole run; the
/// updated twin is left out without `closed`.
fn push_gap_row(
    rows: &mut String,
    name: &str,
    [before, after]: [String; 2],
    closed: Option<String>,
    whole: Option<[String; 2]>,
) {
    let is_updated = closed.is_some();
    let mut cells = vec![before];
    cells.extend(closed.into_iter().flat_map(|closed| [after.clone(), closed]));
    cells.extend(
        whole.into_iter().flat_map(|[before, after]| [Some(before), is_updated.then_some(after)]).flatten(),
    );
    let cells: String = cells.iter().map(|c| format!("<td class=\"number\">{c}</td>")).collect();
    writeln!(rows, "<tr><td>{name}</td>{cells}</tr>").ok();
}

/// The text with a capital first letter.
fn with_capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}
