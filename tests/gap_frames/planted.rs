//! Faults planted in reports and outcomes, which the judge of the suite must notice.

use serde_json::{Value, json};
use synth::{Family, Object, SynthConfig, further_states};

use crate::{
    FURTHER, HELD, MISSED,
    case::usable,
    complaints,
    hidden::{Hidden, RECORDINGS},
    judge::{Expected, expected, judge},
    suite::{Outcome, rows},
};

/// A report that says what it should.
fn right_report(expected: Option<&Expected>) -> Value {
    let gap = json!({"before": 0.01, "after": 0.001, "noise_floor": 0.001});
    let Some(expected) = expected else {
        return json!({"verdict": "none", "findings": [], "gap": gap});
    };
    let mut parameters = Vec::new();
    for t in &expected.truth {
        let interval = [t.value - 0.001, t.value + 0.001];
        parameters.push(json!({"name": t.name, "value": t.value, "interval": interval}));
    }
    let finding = json!({
        "effect": expected.effect,
        "joint": expected.subject,
        "type": {"to": expected.to_type},
        "parameters": parameters,
    });
    json!({"verdict": "named", "findings": [finding], "gap": gap})
}

/// What a report should say of every row's first case.
fn all_expected() -> Vec<(Hidden, Option<Expected>)> {
    let config = SynthConfig { parts: Some(2), views: 4, width: 160, height: 120, ..SynthConfig::default() };
    let made = |hidden: Hidden| -> (Object, Vec<Object>) {
        let family = hidden.needs_screw().then_some(Family::CappedBox);
        let (object, config) = usable(&SynthConfig { family, ..config.clone() }, hidden);
        let states = further_states(&object, RECORDINGS, &config).unwrap();
        (object, states)
    };
    let (plain, screw) = (made(Hidden::Nothing), made(Hidden::NoThread));
    let mut all = Vec::new();
    for row in rows() {
        let hidden = row.strengths[0];
        let (object, states) = if hidden.needs_screw() { &screw } else { &plain };
        all.push((hidden, expected(hidden, object, states, 0)));
    }
    all
}

#[test]
fn an_effect_named_wrongly_is_caught() {
    let all = all_expected();
    let names: Vec<&str> = all.iter().filter_map(|(_, e)| Some(e.as_ref()?.effect)).collect();
    for (hidden, expected) in &all {
        let right = right_report(expected.as_ref());
        let judged = judge(&right, expected.as_ref());
        assert_eq!(judged.wrong, None, "{hidden:?}");
        assert_eq!(judged.held[0], judged.held[1], "{hidden:?}");
        let is_wrong = |report: &Value| judge(report, expected.as_ref()).wrong.is_some();
        let Some(own) = expected else {
            let named = right_report(all[0].1.as_ref());
            assert!(is_wrong(&named), "{hidden:?}: a name of a twin without errors");
            continue;
        };
        for name in names.iter().filter(|name| **name != own.effect) {
            let mut report = right.clone();
            report["findings"][0]["effect"] = json!(name);
            assert!(is_wrong(&report), "{hidden:?} named {name}");
        }
        let mut faults = vec![
            ("/findings", json!([])),
            ("/findings/0/joint", json!("another_joint")),
            ("/gap/after", json!(0.009)),
        ];
        if own.to_type.is_some() {
            faults.push(("/findings/0/type/to", json!("another")));
        }
        for (place, value) in faults {
            let mut report = right.clone();
            *report.pointer_mut(place).unwrap() = value;
            assert!(is_wrong(&report), "{hidden:?}: {place}");
        }
    }
}

#[test]
fn a_value_out_of_its_interval_is_counted() {
    for (hidden, expected) in &all_expected() {
        let Some(own) = expected.as_ref().filter(|e| !e.truth.is_empty()) else { continue };
        let mut report = right_report(expected.as_ref());
        let off = own.truth[0].value + 0.5;
        report["findings"][0]["parameters"][0]["value"] = json!(off);
        report["findings"][0]["parameters"][0]["interval"] = json!([off - 0.1, off + 0.1]);
        let judged = judge(&report, expected.as_ref());
        assert_eq!(judged.held, [own.truth.len() - 1, own.truth.len()], "{hidden:?}");
        assert!(judged.error_share.unwrap() > 0.3, "{hidden:?}");
    }
}

/// Outcomes of the small suite that are as they were when its figures were set.
fn as_measured() -> Vec<Outcome> {
    let mut all = Vec::new();
    for row in rows() {
        all.push(Outcome {
            row: row.name,
            hidden: row.strengths[0],
            object: String::new(),
            seed: 0,
            wrong: MISSED.contains(&row.name).then(|| "another name".to_owned()),
            held: [0, 0],
            error_share: None,
            further: Vec::new(),
            gap_mm: [1.0; 3],
            summary: String::new(),
        });
    }
    all[0].held = [HELD, HELD];
    all[0].further = vec!["depth_bias".to_owned(); FURTHER];
    all
}

#[test]
fn a_suite_with_a_wrong_name_fails() {
    assert_eq!(complaints(&as_measured()), Vec::<String>::new());
    for k in 0..as_measured().len() {
        // A row that was right gets a wrong name, one that was wrong the right one.
        let mut outcomes = as_measured();
        outcomes[k].wrong = outcomes[k].wrong.is_none().then(|| "another name".to_owned());
        assert_eq!(complaints(&outcomes).len(), 1, "{}", outcomes[k].row);
    }
    let mut outcomes = as_measured();
    outcomes[0].held[0] -= 1;
    outcomes[0].further.push("axis_play".to_owned());
    outcomes[0].error_share = Some(0.1);
    assert_eq!(complaints(&outcomes).len(), 3);
}
