//! Why a view has no place.

/// Why a frame has no place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Lost {
    /// Neither features nor the motion before gave a guess.
    NoGuess,
    /// It shows too little of the keyframes' surface.
    LittleShared,
    /// Surfaces contradict each other.
    Contradicted,
    /// The common surface leaves a motion open.
    Undetermined,
    /// Neither light nor depth came in.
    Covered,
    /// Too little light came in.
    Dark,
    /// Hardly a pixel has depth.
    Unread,
    /// Nothing in it stands out from its surroundings.
    Blank,
}

impl Lost {
    /// Reason of most of the views without a place, for people; placed views give none.
    #[must_use]
    pub fn most_frequent_reason(reasons: &[Option<Self>]) -> &'static str {
        let counts =
            reasons.iter().flatten().map(|why| (reasons.iter().filter(|r| **r == Some(*why)).count(), *why));
        counts.max().map_or(
            "no other view hangs together with them; move slower, and look back at what was seen",
            |(_, why)| why.reason(),
        )
    }

    /// The event and its remedy, for people.
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

    /// Whether the view itself shows nothing.
    #[must_use]
    pub fn is_blind(self) -> bool {
        matches!(self, Self::Covered | Self::Dark | Self::Unread | Self::Blank)
    }

    /// The remedy, for people: the end of [`Self::reason`].
    #[must_use]
    pub fn remedy(self) -> &'static str {
        self.reason().split_once("; ").map_or(self.reason(), |(_, remedy)| remedy)
    }
}
