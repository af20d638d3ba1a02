//! Why a view cannot be located.

/// Why a view cannot be located.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Lost {
    /// Neither landmarks nor the previous motion give an approximate pose.
    NoGuess,
    /// It shows too little of the keyframes' surface.
    LittleShared,
    /// Its surfaces contradict those of the keyframes.
    Contradicted,
    /// The common surface leaves a motion undetermined.
    Undetermined,
    /// The camera is covered: neither light nor depth.
    Covered,
    /// The image is too dark.
    Dark,
    /// Almost no pixel has depth.
    Unread,
    /// The image has no distinct features.
    Blank,
}

impl Lost {
    /// Message with the most frequent reason among the lost views; entries of located views are `None`.
    #[must_use]
    pub fn most_frequent_reason(reasons: &[Option<Self>]) -> String {
        let counts =
            reasons.iter().flatten().map(|why| (reasons.iter().filter(|r| **r == Some(*why)).count(), *why));
        let nowhere = "no other view hangs together with them; move slower, and look back at what was seen";
        counts.max().map_or(nowhere.to_owned(), |(_, why)| why.reason())
    }

    /// The reason and its remedy.
    #[must_use]
    pub fn reason(self) -> String {
        format!("{}; {}", self.cause(), self.remedy())
    }

    fn cause(self) -> &'static str {
        match self {
            Self::NoGuess => "nothing in them was seen before",
            Self::LittleShared => "they share little surface with others",
            Self::Contradicted => "their surfaces contradict those of other views",
            Self::Undetermined => "what they show leaves a motion open, as a plain wall does",
            Self::Covered => "they are dark and without depth",
            Self::Dark => "they are too dark",
            Self::Unread => "hardly a pixel has depth",
            Self::Blank => "they show nothing that can be found again",
        }
    }

    /// What to do about it.
    #[must_use]
    pub fn remedy(self) -> &'static str {
        match self {
            Self::NoGuess => "move slower, look back at what was seen",
            Self::LittleShared => "move slower, and look back at what was seen",
            Self::Contradicted => "let nothing move but the camera, and that slower",
            Self::Undetermined | Self::Blank => "keep corners and texture in view",
            Self::Covered => "keep the lens free, and 0.3 m away from things",
            Self::Dark => "give more light",
            Self::Unread => {
                "keep the distance that the sensor measures, and out of the sun; depth that does not count \
                 millimeters needs `capture.depth_unit_m` (0.0001 of a D405)"
            }
        }
    }

    /// Whether the view itself is unusable.
    #[must_use]
    pub fn is_blind(self) -> bool {
        matches!(self, Self::Covered | Self::Dark | Self::Unread | Self::Blank)
    }
}
