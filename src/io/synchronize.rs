//! Pairs color, depth and mask messages of the same views.

use super::{
    bag_index::{BagIndex, ImageEntry},
    topics::TopicChoice,
};
use capture::{CaptureConfig, CaptureError, pair, stamp_secs};
use common::note::{Note, NoteCode};

/// Longest time between images of one camera, and between color and depth of cameras that do not wait for
/// each other, nanoseconds.
/// derived: half a period at 10 Hz, below which no camera runs by hand
pub(super) const MOST_FREE_RUNNING_NANOS: i64 = 50_000_000;
/// Clocks whose messages were recorded this much later than those of others are not the same, nanoseconds.
/// chosen: beyond the delay of any driver
pub(super) const OTHER_CLOCK_NANOS: i64 = 1_000_000_000;

/// The messages of a view.
pub(super) struct Matched {
    pub color: ImageEntry,
    pub depth: ImageEntry,
    pub mask: Option<ImageEntry>,
}

/// Partners of the color images among the images of a topic, and how they were found.
struct Partners {
    of_color: Vec<Option<usize>>,
    warning: Option<Note>,
}

impl Partners {
    fn count(&self) -> usize {
        self.of_color.iter().flatten().count()
    }
}

/// The views of chosen topics, sorted by stamp; losses are added to `warnings`.
///
/// # Errors
/// [`CaptureError::NoFrames`] where no color image has depth.
pub(super) fn synchronized(
    topics: &TopicChoice,
    index: &BagIndex,
    config: &CaptureConfig,
    state: usize,
    warnings: &mut Vec<Note>,
) -> Result<Vec<Matched>, CaptureError> {
    let entries = |topic: &str| index.images.get(topic).map_or(&[][..], |i| &i.entries[..]);
    let color = entries(&topics.color);
    warnings.extend(unstamped(topics, index));
    // Color leads (docs/method.md 2.2): each view has the stamp, camera and pose of its color image.
    let mut depth = partners([&topics.color, &topics.depth], index, config);
    warnings.extend(depth.warning.take());
    // Masks that are not used must not cost frames without one.
    let wanted_masks = topics.mask.as_ref().filter(|_| config.isolate.use_masks);
    let masks = wanted_masks.map(|topic| (topic, partners([&topics.color, topic], index, config)));
    let mut matched = Vec::new();
    let mut no_mask = 0;
    for (i, entry) in color.iter().enumerate() {
        let Some(d) = depth.of_color[i] else { continue };
        let mask = match &masks {
            Some((topic, partners)) => match partners.of_color[i] {
                Some(m) => Some(entries(topic)[m].clone()),
                None => {
                    // Without its mask, a frame's background would count as the object.
                    no_mask += 1;
                    continue;
                }
            },
            None => None,
        };
        matched.push(Matched { color: entry.clone(), depth: entries(&topics.depth)[d].clone(), mask });
    }
    let slop_ms = config.sync_slop_secs * 1e3;
    let all = color.len();
    let no_depth = all - depth.count();
    if no_depth > 0 {
        warnings.push(Note::new(
            NoteCode::DepthUnpaired,
            format!(
                "state {state}: {no_depth} of {all} color images have no depth image within {slop_ms} ms and \
                 are not used"
            ),
        ));
    }
    if no_mask > 0 {
        warnings.push(Note::new(
            NoteCode::MasksUnpaired,
            format!(
                "state {state}: {no_mask} of {all} color images have no mask within {slop_ms} ms and are not \
                 used"
            ),
        ));
    }
    for topic in [&topics.color, &topics.depth] {
        if let Some(strays) = index.images.get(topic).map(|i| i.strays).filter(|n| *n > 0) {
            warnings.push(Note::new(
                NoteCode::ImagesInOtherFrame,
                format!("{topic}: {strays} images are in another frame than the first and are not used"),
            ));
        }
    }
    if matched.is_empty() {
        let reason = format!(
            "of {all} color and {} depth images none are within {slop_ms} ms of each other{}; check the \
             header stamps or raise the limit with `--set capture.sync_slop_secs=SECONDS`",
            entries(&topics.depth).len(),
            if no_mask > 0 { " and of a mask" } else { "" }
        );
        return Err(CaptureError::NoFrames { state, reason });
    }
    // Messages are in the order of recording, which may differ from that of their stamps.
    matched.sort_by_key(|m| (m.color.stamp_nanos, m.color.ordinal));
    Ok(matched)
}

/// Stamps of the images of a topic, nanoseconds.
fn stamps_of_topic(index: &BagIndex, topic: &str) -> Vec<i64> {
    index.images.get(topic).into_iter().flat_map(|i| &i.entries).map(|e| e.stamp_nanos).collect()
}

/// The partners of color images among those of another topic: by their stamps, or, where these pair less than
/// half of them, by stamps on the clock of color or of cameras that do not wait for each other.
fn partners([color, other]: [&str; 2], index: &BagIndex, config: &CaptureConfig) -> Partners {
    let of_color = stamps_of_topic(index, color);
    let of_other = stamps_of_topic(index, other);
    let slop = (config.sync_slop_secs * 1e9) as i64;
    let by_stamp = Partners { of_color: pair(&of_color, &of_other, slop), warning: None };
    let least = of_color.len().min(of_other.len()).div_ceil(2);
    if by_stamp.count() >= least {
        return by_stamp;
    }
    let lag = |topic: &str| index.images.get(topic).and_then(|i| i.lags.median_nanos()).unwrap_or(0);
    let behind = lag(other) - lag(color);
    let mut tries = Vec::new();
    if behind.abs() > OTHER_CLOCK_NANOS {
        let shifted: Vec<i64> = of_other.iter().map(|t| t + behind).collect();
        let text = format!(
            "{other}: stamps are {:.3} s off those of {color} by the times of recording, which are used in \
             their place; give both one clock",
            stamp_secs(-behind)
        );
        // Times of recording jitter by the time a message takes.
        let reach = slop.max(half_period_nanos(&of_color));
        tries.push((pair(&of_color, &shifted, reach), text));
    }
    let reach = half_period_nanos(&of_color);
    if reach > slop {
        let text = format!(
            "{other}: images are up to {:.0} ms from those of {color}: the cameras do not wait for each \
             other, and what moves is seen at two places; synchronize them",
            1e3 * stamp_secs(reach)
        );
        tries.push((pair(&of_color, &of_other, reach), text));
    }
    for (of_color, text) in tries {
        let found = Partners { of_color, warning: Some(Note::new(NoteCode::ClocksDiffer, text)) };
        if found.count() >= least {
            return found;
        }
    }
    by_stamp
}

/// Half of the median time between images, at most that of cameras that run freely, nanoseconds.
fn half_period_nanos(stamps: &[i64]) -> i64 {
    let mut sorted = stamps.to_vec();
    sorted.sort_unstable();
    let mut gaps: Vec<i64> = sorted.windows(2).map(|w| w[1] - w[0]).collect();
    gaps.sort_unstable();
    // Stamps are rounded to a millisecond by some drivers.
    let half = gaps.get(gaps.len() / 2).map_or(0, |gap| gap / 2 + 1_000_000);
    half.min(MOST_FREE_RUNNING_NANOS)
}

/// How many images of a topic have no stamp, if any.
fn unstamped_of_topic(topic: &str, index: &BagIndex) -> Option<String> {
    let count = index.images.get(topic)?.lags.unstamped;
    (count > 0).then(|| format!("{count} on {topic}"))
}

/// A warning about images of the chosen topics without a stamp.
fn unstamped(topics: &TopicChoice, index: &BagIndex) -> Option<Note> {
    let found: Vec<String> = [Some(&topics.color), Some(&topics.depth), topics.mask.as_ref()]
        .into_iter()
        .flatten()
        .filter_map(|topic| unstamped_of_topic(topic, index))
        .collect();
    (!found.is_empty()).then(|| {
        let text = format!(
            "images have no stamp ({}); the time of their recording is used; let the driver stamp them",
            found.join(", ")
        );
        Note::new(NoteCode::StampsMissing, text)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bag_index::ImageTopic;

    const MS: i64 = 1_000_000;

    /// Images every 100 ms, of stamps that are `off` from the times of recording.
    fn images(off_ms: i64, late_ms: i64) -> ImageTopic {
        let mut topic = ImageTopic::default();
        for k in 1..10 {
            let log_nanos = 1_000_000 * MS + 100 * k * MS + late_ms * MS;
            let stamp_nanos = log_nanos + off_ms * MS;
            topic.lags.add(stamp_nanos, log_nanos);
            topic.entries.push(ImageEntry { ordinal: k as usize, stamp_nanos, log_nanos, size: None });
        }
        topic
    }

    fn warning(depth: ImageTopic) -> Option<String> {
        let mut index = BagIndex::default();
        index.images.insert("/c".into(), images(0, 0));
        index.images.insert("/d".into(), depth);
        let topics = TopicChoice { color: "/c".into(), depth: "/d".into(), ..TopicChoice::default() };
        let mut warnings = Vec::new();
        let found = synchronized(&topics, &index, &CaptureConfig::default(), 0, &mut warnings).unwrap();
        assert!(found.iter().all(|m| m.color.ordinal == m.depth.ordinal));
        assert_eq!(found.len(), 9);
        warnings.pop().map(|w| w.text)
    }

    #[test]
    fn images_of_two_clocks_and_of_free_cameras_are_paired_and_that_is_told() {
        assert_eq!(warning(images(2, 0)), None);
        let off = warning(images(5000, 0)).unwrap();
        assert!(off.contains("stamps are 5.000 s off"), "{off}");
        let free = warning(images(0, 30)).unwrap();
        assert!(free.contains("do not wait for each other"), "{free}");
    }
}
