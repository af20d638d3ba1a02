//! What is said of a joint beside its numbers. Links stand in it by index: they get their names last.

use serde::{Deserialize, Serialize};

use common::note::{Note, NoteCode};

/// A remark on a joint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum JointRemark {
    /// A remark that names no link.
    Plain(Note),
    /// Other links would do as well as the parent, which the shortest chain makes it.
    OtherParents {
        /// Indices of the other links.
        others: Vec<usize>,
        /// Index of the parent.
        parent: usize,
    },
    /// The motion against the static part is as simple as that against the parent.
    StaticAsSimple {
        /// Index of the static part.
        link: usize,
        /// Distance from the static part, meters; `None` where they touch and the axis would not run by both.
        gap_m: Option<f64>,
        /// Distance of a turn's axis against the static part from that against the parent, meters.
        axis_off_m: Option<f64>,
    },
    /// A state contradicts the joint that the others show; it is left out of the axis.
    StateContradicts {
        /// Index of the state.
        state: usize,
        /// Distance of the part's middle there from where the joint puts it, meters.
        off_m: f64,
        /// Angle of the part there from the joint's, radians.
        off_rad: f64,
    },
    /// No other part touches it in all states.
    Untouched {
        /// Index of the link.
        link: usize,
        /// Number of states.
        states: usize,
    },
}

impl From<Note> for JointRemark {
    fn from(note: Note) -> Self {
        Self::Plain(note)
    }
}

impl JointRemark {
    /// Its code.
    #[must_use]
    pub fn code(&self) -> NoteCode {
        match self {
            Self::Plain(note) => note.code,
            Self::OtherParents { .. } | Self::StaticAsSimple { .. } => NoteCode::ParentNotDecided,
            Self::StateContradicts { .. } => NoteCode::StateContradicts,
            Self::Untouched { .. } => NoteCode::PartUntouched,
        }
    }

    /// Its sentence, with the names of the links.
    #[must_use]
    pub fn note(&self, link_name: impl Fn(usize) -> String) -> Note {
        let text = match self {
            Self::Plain(note) => return note.clone(),
            Self::OtherParents { others, parent } => {
                let others: Vec<String> = others.iter().map(|&link| link_name(link)).collect();
                format!(
                    "the parent: {} would do as well as {}, which the shortest chain makes it",
                    others.join(" or "),
                    link_name(*parent)
                )
            }
            Self::StaticAsSimple { link, gap_m, axis_off_m } => {
                let name = link_name(*link);
                let why = gap_m.map_or("its axis would not run by both".to_owned(), |gap_m| {
                    format!("{name} is {:.0} mm away", 1e3 * gap_m)
                });
                let off = axis_off_m.map_or(String::new(), |off_m| {
                    format!("; there the axis would lie {:.0} mm from here", 1e3 * off_m)
                });
                format!("the parent: the motion against {name} is as simple, but {why}{off}")
            }
            Self::StateContradicts { state, off_m, off_rad } => format!(
                "state {state} contradicts the other states: there the part is {:.1} mm and {:.1} deg off \
                 the joint that they show; it is left out of the axis",
                1e3 * off_m,
                off_rad.to_degrees()
            ),
            Self::Untouched { link, states } => {
                let all = if *states == 2 { "both" } else { "all" };
                format!("no part touches {} in {all} states; it hangs on the static part", link_name(*link))
            }
        };
        Note::new(self.code(), text)
    }
}
