//! A doubt in words.

use super::doubt::{Doubt, Looks};
use common::note::{Note, NoteCode};

impl Looks {
    /// What the input looks like.
    #[must_use]
    pub fn in_words(&self) -> String {
        match self {
            Self::Convention(c) => c.looks.to_owned(),
            Self::EffortsOf(other) => format!("the efforts of joint '{other}' move it, its own do not"),
        }
    }

    /// What the user should do.
    #[must_use]
    pub fn remedy_text(&self) -> &'static str {
        match self {
            Self::Convention(c) => c.remedy,
            Self::EffortsOf(_) => "check that names and efforts have one order in the recording",
        }
    }

    fn note_code(&self) -> NoteCode {
        match self {
            Self::EffortsOf(_) => NoteCode::EffortsOfOtherJoint,
            Self::Convention(c) if c.is_of_sign() => NoteCode::EffortSignTurned,
            Self::Convention(_) => NoteCode::UnitsDoubtful,
        }
    }
}

impl Doubt {
    /// Code of its note.
    #[must_use]
    pub fn note_code(&self) -> NoteCode {
        self.looks.first().map_or(NoteCode::UnitsDoubtful, Looks::note_code)
    }

    /// What the input looks like; alternatives are joined by "or".
    #[must_use]
    pub fn looks_text(&self) -> String {
        self.distinct_texts(&Looks::in_words)
    }

    /// What the user should do; alternatives are joined by "or".
    #[must_use]
    pub fn remedy_text(&self) -> String {
        self.distinct_texts(&|looks| looks.remedy_text().to_owned())
    }

    /// The distinct texts of all alternatives, joined by "or".
    fn distinct_texts(&self, of: &dyn Fn(&Looks) -> String) -> String {
        let mut all: Vec<String> = Vec::new();
        for words in self.looks.iter().map(of) {
            if !all.contains(&words) {
                all.push(words);
            }
        }
        all.join(", or ")
    }

    /// The doubt and its evidence in words, without the joint's name.
    #[must_use]
    pub fn in_words(&self) -> String {
        let looks = self.looks_text();
        let remedy = self.remedy_text();
        if let Some(by) = &self.by {
            return format!("{looks}, as joint '{by}' shows: no name is given on such numbers; {remedy}");
        }
        let inertia = match self.note_code() {
            NoteCode::UnitsDoubtful => {
                format!("the twin's inertia is {:.1e} times what they show; ", self.inertia_ratio)
            }
            _ => String::new(),
        };
        let so = 100.0 * self.left.0;
        let given = 100.0 * self.left.1;
        format!(
            "{looks}, by motion and efforts (log odds {:.0}): {inertia}so {so:.1} % of the squared effort is \
             left unexplained, as given {given:.1} %; no name is given on such numbers; {remedy}",
            self.log_odds
        )
    }

    /// The doubt as a note.
    #[must_use]
    pub fn note(&self) -> Note {
        Note::new(self.note_code(), format!("joint '{}': {}", self.joint, self.in_words()))
    }
}
