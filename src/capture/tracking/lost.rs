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
    pub fn most_frequent_reason(reasons: &[Option<Self>]) -> &'static str {
        let counts =
            reasons.iter().flatten().map(|why| (reasons.iter().filter(|r| **r == Some(*why)).count(), *why));
        counts.max().map_or(
            "no other view hangs together with them; move slower, and look back at what was seen",
            |(_, why)| why.reason(),
        )
    }

    /// Message with the reason and its remedy.
    #[must_use]
    pub fn reason(self) -> &'static str {
        match self {
            Self::NoGuess => "nothing in them was seen before; move slower, look back at what was seen",
            Self::LittleShared => {
                "they share little surface with others; move slower, and look back at what was seen"
            }
            Self::Contradicted => {
                "their surfaces contradict those of other views; let nothing move but the camera, \
                 and that slower"
            }
            Self::Undetermined => {
                "what they show leaves a motion open, as a plain wall does; keep corners and texture in \
                 view"
            }
            Self::Covered => {
                "they are dark and without depth; keep the lens free, and 0.3 m away from things"
            }
            Self::Dark => "they are too dark; give more light",
            Self::Unread => {
                "hardly a pixel has depth; keep the distance that the sensor measures, and out of the sun"
            }
            Self::Blank => "they show nothing that can be found again; keep corners and texture in view",
        }
    }

    /// Whether the view itself is unusable.
    #[must_use]
    pub fn is_blind(self) -> bool {
        matches!(self, Self::Covered | Self::Dark | Self::Unread | Self::Blank)
    }

    /// Remedy in a message: the end of [`Self::reason`].
    #[must_use]
    pub fn remedy(self) -> &'static str {
        self.reason().split_once("; ").map_or(self.reason(), |(_, remedy)| remedy)
    }
}
