//! One word of verdict on a whole result, and the reason.

use serde::Serialize;

use super::{difference_report::StateDifference, page::counted_noun};
use common::note::Note;

/// What can be done with a twin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum OverallWord {
    /// There is no warning.
    #[default]
    Usable,
    /// There are warnings, but none puts a part, a joint or a shape in doubt
    /// ([`common::note::NoteCode::doubts_twin`]).
    UsableWithWarnings,
    /// A warning puts a part, a joint or a shape in doubt.
    LookBeforeUse,
}

/// A word with its reason.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Overall {
    /// The word.
    pub word: OverallWord,
    /// One or two sentences.
    pub reason: String,
}

impl Overall {
    /// The verdict on a twin with this number of joints, from the warnings and differences of its run.
    pub fn of_run(joints: usize, warnings: &[Note], differences: &[StateDifference]) -> Self {
        let doubts: Vec<&Note> = warnings.iter().filter(|w| w.code.doubts_twin()).collect();
        let (word, mut sentences) = if let Some((first, others)) = doubts.split_first() {
            let more =
                if others.is_empty() { String::new() } else { format!(" (and {} more)", others.len()) };
            (OverallWord::LookBeforeUse, vec![format!("{}{more}", first.text)])
        } else if warnings.is_empty() {
            let of = match joints {
                0 => "no part was seen to move, so that the twin is one body",
                1 => "nothing speaks against the joint",
                _ => "nothing speaks against the joints",
            };
            (OverallWord::Usable, vec![of.to_owned()])
        } else {
            let text = "what is warned of below puts no part, joint or shape in question";
            (OverallWord::UsableWithWarnings, vec![text.to_owned()])
        };
        if word != OverallWord::LookBeforeUse {
            sentences.extend(agreement_sentence(differences));
        }
        Self { word, reason: sentences.join("; ") }
    }

    /// The verdict in words, for a result with this number of warnings.
    pub fn title_text(&self, warnings: usize) -> String {
        match self.word {
            OverallWord::Usable => "Usable".to_owned(),
            OverallWord::UsableWithWarnings => format!("Usable, with {}", counted_noun(warnings, "warning")),
            OverallWord::LookBeforeUse => "Look before use".to_owned(),
        }
    }
}

/// A sentence with the share of depth readings that the twin explains; none without readings.
fn agreement_sentence(differences: &[StateDifference]) -> Option<String> {
    let views: usize = differences.iter().map(|d| d.views.len()).sum();
    let readings: usize = differences.iter().map(|d| d.readings).sum();
    let differing: f64 = differences.iter().map(|d| d.share * d.readings as f64).sum();
    (readings > 0).then(|| {
        let share = 100.0 * (1.0 - differing / readings as f64);
        format!(
            "the twin explains {share:.2} % of the depth that {} read of the object",
            counted_noun(views, "view")
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use common::note::NoteCode;

    #[test]
    fn the_word_follows_the_warnings() {
        let of = |codes: &[NoteCode]| {
            let notes: Vec<Note> = codes.iter().map(|c| Note::new(*c, c.word())).collect();
            let overall = Overall::of_run(1, &notes, &[]);
            (overall.title_text(notes.len()), overall.reason)
        };
        let (title, reason) = of(&[]);
        assert_eq!((title.as_str(), reason.as_str()), ("Usable", "nothing speaks against the joint"));
        assert_eq!(of(&[NoteCode::PosesMissing, NoteCode::SolidsOff]).0, "Usable, with 2 warnings");
        let (title, reason) = of(&[NoteCode::PosesMissing, NoteCode::TwinDiffers, NoteCode::AxisCoarse]);
        assert_eq!((title.as_str(), reason.as_str()), ("Look before use", "twin_differs (and 1 more)"));
    }

    #[test]
    fn a_usable_twin_says_how_much_of_the_readings_it_explains() {
        let state = |readings, share| StateDifference { readings, share, ..StateDifference::default() };
        let overall = Overall::of_run(2, &[], &[state(3000, 0.02), state(1000, 0.06)]);
        assert!(overall.reason.contains("the twin explains 97.00 % of the depth"), "{overall:?}");
        assert!(Overall::of_run(0, &[], &[]).reason.contains("one body"));
    }
}
