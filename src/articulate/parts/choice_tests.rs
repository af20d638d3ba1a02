//! The choice among hand-made sets of motions.

use super::*;
use crate::samples::synthetic::Scene;

/// The test of a box with a lid, which moved unless it is `at_rest`.
fn of_box(at_rest: bool, test: impl Fn(&MatchedPair<'_>, Pose)) {
    let mut scene = Scene::box_with_lid();
    if at_rest {
        scene.parts.iter_mut().for_each(|p| p.motion = Pose::identity());
    }
    scene.seen(0.02, 0.02, |surfaces, _| {
        test(&MatchedPair::new(&[], 0.4, surfaces), scene.truth(1));
    });
}

/// A set of so many motions, the first at rest.
fn step(weakest: Option<f64>, evidence: f64, shares: &[f64]) -> Step {
    let motions = (0..shares.len()).map(|k| Pose::translation(0.1 * k as f64, 0.0, 0.0)).collect();
    let point = EvidencePoint { parts: shares.len(), evidence, weakest, unexplained: 0.0 };
    Step { motions, point, shares: shares.to_vec(), divided: false }
}

/// Sets of four motions to one; those of three and two stand, of which the weakest have this evidence.
fn steps(four: f64, three: f64) -> Vec<Step> {
    vec![
        step(Some(four), 90.0 + three + four, &[0.6, 0.2, 0.1, 0.05]),
        step(Some(three), 90.0 + three, &[0.6, 0.2, 0.1]),
        step(Some(90.0), 90.0, &[0.7, 0.123]),
        step(None, 0.0, &[0.8]),
    ]
}

fn codes(notes: &[Note]) -> Vec<NoteCode> {
    notes.iter().map(|n| n.code).collect()
}

#[test]
fn the_largest_set_that_stands_is_chosen() {
    of_box(false, |pair, _| {
        let steps = steps(2.0, 40.0);
        let found = chosen_parts(pair, &steps, None).unwrap();
        assert_eq!(found.motions, steps[1].motions);
        assert_eq!(found.curve, steps.iter().map(|s| s.point.clone()).collect::<Vec<_>>());
        assert!(found.notes.is_empty() && found.warnings.is_empty());
        // Not more than was asked for; that more are evident is said.
        let asked = chosen_parts(pair, &steps, Some(2)).unwrap();
        assert_eq!(asked.motions, steps[2].motions);
        assert_eq!(codes(&asked.warnings), [NoteCode::MorePartsEvident]);
        assert_eq!(asked.warnings[0].text, "the evidence is for 3 parts, 2 were asked for");
        assert!(chosen_parts(pair, &steps, Some(3)).unwrap().warnings.is_empty());
    });
}

#[test]
fn a_part_on_little_evidence_is_said_unless_the_number_was_given() {
    of_box(false, |pair, _| {
        // The least is 14 cells; one and a half times that leaves no doubt.
        let of = |three: f64, parts: Option<usize>| chosen_parts(pair, &steps(2.0, three), parts).unwrap();
        let found = of(20.9, None);
        assert_eq!(codes(&found.warnings), [NoteCode::PartOnLittleEvidence]);
        let text = "one of the 3 parts rests on little evidence: 21 cells, where 21 leave no doubt";
        assert_eq!(found.warnings[0].text, text);
        assert!(of(21.0, None).warnings.is_empty() && of(20.9, Some(3)).warnings.is_empty());
    });
}

#[test]
fn a_part_that_is_almost_evident_is_noted_unless_the_number_was_given() {
    of_box(false, |pair, _| {
        // From half of the least on.
        let of = |four: f64, parts: Option<usize>| chosen_parts(pair, &steps(four, 40.0), parts).unwrap();
        let found = of(7.1, None);
        assert_eq!((found.motions.len(), codes(&found.notes)), (3, vec![NoteCode::PartAlmostEvident]));
        assert_eq!(found.notes[0].text, "a further motion has 7.1 of the evidence of 14 that a part needs");
        assert!(of(7.0, None).notes.is_empty() && of(7.1, Some(3)).notes.is_empty());
    });
}

#[test]
fn a_part_that_was_divided_is_noted() {
    of_box(false, |pair, _| {
        let mut steps = steps(2.0, 40.0);
        steps[1].divided = true;
        assert_eq!(codes(&chosen_parts(pair, &steps, None).unwrap().notes), [NoteCode::PartsMoveAlike]);
        assert!(chosen_parts(pair, &steps, Some(2)).unwrap().notes.is_empty());
    });
}

#[test]
fn nothing_that_stands_is_no_overlap() {
    of_box(false, |pair, _| {
        assert_eq!(
            chosen_parts(pair, &[], None).unwrap_err(),
            RegisterError::NoOverlap { static_percent: 0.0 }
        );
        // The static part must be somewhere.
        let refused = |share: f64| chosen_parts(pair, &[step(Some(50.0), 50.0, &[share, 0.5])], None);
        assert_eq!(refused(0.015).unwrap_err(), RegisterError::NoOverlap { static_percent: 1.5 });
        assert_eq!(refused(0.02).unwrap().motions.len(), 2);
    });
}

#[test]
fn parts_that_were_asked_for_in_vain_are_refused() {
    of_box(false, |pair, _| {
        let refused = chosen_parts(pair, &steps(2.0, 40.0)[2..], Some(4)).unwrap_err();
        let support = "12.3 % of the surface".to_owned();
        assert_eq!(refused, RegisterError::FewerParts { asked: 4, found: 2, moving: 1, support });
        let refused = chosen_parts(pair, &steps(2.0, 40.0)[3..], Some(2)).unwrap_err();
        assert_eq!(refused, RegisterError::NoMotion { static_percent: 80.0 });
    });
}

#[test]
fn surface_that_left_its_place_unexplained_is_refused() {
    of_box(false, |pair, lid| {
        let at_rest = |share: f64| chosen_parts(pair, &[step(None, 0.0, &[share])], None).map(|_| ());
        let Err(RegisterError::Unexplained { moved_percent }) = at_rest(0.8) else { panic!() };
        let moved = Unexplained::left_by_motions(&pair.surfaces, &[Pose::identity()]).moved;
        let shares = moved.map(|m| 100.0 * m.iter().filter(|m| **m).count() as f64 / m.len() as f64);
        assert!((moved_percent - shares[0].max(shares[1])).abs() < 1e-9, "{moved_percent} {shares:?}");
        assert!(moved_percent > 5.0, "{moved_percent}");
        // With the lid's motion nothing is left, and nothing is to be said.
        let mut both = step(Some(50.0), 50.0, &[0.3, 0.2]);
        both.motions[1] = lid;
        assert!(chosen_parts(pair, &[both], None).unwrap().notes.is_empty());
    });
}

#[test]
fn an_object_at_rest_is_said_where_most_of_it_is_seen_at_rest() {
    of_box(true, |pair, _| {
        let of = |share: f64| chosen_parts(pair, &[step(None, 0.0, &[share])], None);
        let found = of(0.5).unwrap();
        assert_eq!(codes(&found.notes), [NoteCode::NoPartMoved]);
        let text = &found.notes[0].text;
        assert!(text.starts_with("no part moved: 50 % of the surface stands still and 0."), "{text}");
        let refused = of(0.49).unwrap_err();
        assert!(
            matches!(refused, RegisterError::LittleShared { static_percent, moved_percent }
                if static_percent == 49.0 && moved_percent < 1.0),
            "{refused:?}"
        );
    });
}
