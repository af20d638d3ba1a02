//! `/diagnostics`: rates, losses, queues, memory, device.

use std::time::Duration;

use super::{
    collection::Snapshot, input_count::InputSnapshot, inputs::Input, live_map::LiveStatus,
    track_status::TrackStatus,
};
use field::InstructionSet;
use io::ros2msg::{
    Header, Time,
    diagnostic::{DiagnosticArray, DiagnosticStatus, KeyValue},
};

/// Levels of `diagnostic_msgs`.
const OK: u8 = 0;
const WARN: u8 = 1;
const STALE: u8 = 3;

/// Creates diagnostics, with rates since the previous ones.
#[derive(Debug)]
pub(crate) struct Diagnostics {
    node: String,
    inputs: Vec<Input>,
    last: Vec<InputSnapshot>,
}

impl Diagnostics {
    /// Diagnostics of a node with these inputs.
    #[must_use]
    pub(crate) fn new(node: &str, inputs: Vec<Input>) -> Self {
        let last = vec![InputSnapshot::default(); inputs.len()];
        Self { node: node.to_owned(), inputs, last }
    }

    /// The current diagnostics, `elapsed` after the previous ones.
    pub(crate) fn status_array(
        &mut self,
        stamp: Time,
        elapsed: Duration,
        snapshot: &Snapshot,
    ) -> DiagnosticArray {
        // Two reports may follow immediately if the machine was busy.
        let seconds = elapsed.as_secs_f64().max(1e-3);
        let mut status = Vec::new();
        for (input, last) in self.inputs.iter().zip(&mut self.last) {
            let now = input.count.snapshot();
            status.push(input_status(&self.node, input, now, *last, seconds));
            *last = now;
        }
        status.push(self.collection_status(snapshot));
        status.extend(snapshot.tracking.as_ref().map(|t| self.tracking_status(t)));
        status.extend(snapshot.live.as_ref().map(|l| self.live_map(l)));
        status.push(self.machine_status());
        DiagnosticArray { header: Header { stamp, frame_id: String::new() }, status }
    }

    fn collection_status(&self, s: &Snapshot) -> DiagnosticStatus {
        let c = &s.counts;
        let values = [
            ("keyframes_state0", s.kept[0].to_string()),
            ("keyframes_state1", s.kept[1].to_string()),
            ("matched_sets", s.matched.to_string()),
            ("unmatched_color", s.unmatched[0].to_string()),
            ("unmatched_depth", s.unmatched[1].to_string()),
            ("unmatched_mask", s.unmatched[2].to_string()),
            ("waiting_images", s.waiting.0.to_string()),
            ("waiting_for_pose", s.waiting.1.to_string()),
            ("without_pose", c.without_pose.to_string()),
            ("views_known", c.known.to_string()),
            ("views_beyond_max_keyframes", c.full.to_string()),
            ("views_late", c.late.to_string()),
            ("views_not_decodable", c.broken.to_string()),
            ("refused_header", c.bad_header.to_string()),
            ("refused_size", c.bad_size.to_string()),
            ("refused_value", c.bad_value.to_string()),
            ("refused_transforms", s.transforms.0.to_string()),
            ("time_jumps", (c.jumps + s.transforms.1).to_string()),
            ("session", s.session.display().to_string()),
            ("world_frame", s.world_frame.clone().unwrap_or_default()),
        ];
        // The last problem comes first, as people look for it here.
        let (level, message) = match (&s.problem, s.collecting) {
            (Some(problem), _) => (WARN, problem.clone()),
            (None, Some(state)) => (OK, format!("collecting state {state}")),
            (None, None) => (OK, "not collecting".into()),
        };
        status_of_part(&self.node, "collection", level, message, &values)
    }

    fn tracking_status(&self, t: &TrackStatus) -> DiagnosticStatus {
        let values = [
            ("views_hz", format!("{:.1}", t.views_hz)),
            ("inliers", format!("{:.3}", t.inliers)),
            ("position_error_m", format!("{:.4}", t.error_m)),
            ("keyframes", t.keyframes.to_string()),
            ("views_lost", t.lost.to_string()),
            ("dropped_busy", t.dropped.to_string()),
        ];
        let (level, message) = match t.hint.is_empty() {
            true => (OK, format!("{:.1} views a second, {:.1} mm", t.views_hz, 1e3 * t.error_m)),
            false => (WARN, t.hint.clone()),
        };
        status_of_part(&self.node, "tracking", level, message, &values)
    }

    fn live_map(&self, l: &LiveStatus) -> DiagnosticStatus {
        let area = |k: usize| l.moved_m2.map_or_else(|| "unknown".to_owned(), |m| format!("{:.4}", m[k]));
        let values = [
            ("views_fused", l.fused.to_string()),
            ("left_out_busy", l.left_out.to_string()),
            ("views_unusable", l.unusable.to_string()),
            ("seconds_behind", format!("{:.3}", l.behind_secs)),
            ("seconds_a_view", format!("{:.3}", l.secs)),
            ("unseen_share", l.unseen.map_or_else(|| "unknown".into(), |s| format!("{s:.3}"))),
            ("unseen_m2", format!("{:.4}", l.unseen_m2)),
            ("appeared_m2", area(0)),
            ("gone_m2", area(1)),
            ("spacing_m", format!("{:.4}", l.spacing_m)),
            ("map_bytes", l.bytes.to_string()),
        ];
        let message = match l.unseen {
            Some(share) => format!("{} views, {:.0} % unseen", l.fused, 100.0 * share),
            None => "no view yet".into(),
        };
        status_of_part(&self.node, "live_map", OK, message, &values)
    }

    fn machine_status(&self) -> DiagnosticStatus {
        let memory = resident_bytes();
        let values = [
            ("resident_bytes", memory.map_or_else(|| "unknown".into(), |b| b.to_string())),
            ("device", format!("cpu engine ({})", InstructionSet::detect().name())),
            ("threads", std::thread::available_parallelism().map_or(0, usize::from).to_string()),
        ];
        let message =
            memory.map_or_else(|| "memory unknown".into(), |b| format!("{:.0} MB resident", b as f64 / 1e6));
        status_of_part(&self.node, "machine", OK, message, &values)
    }
}

fn input_status(
    node: &str,
    input: &Input,
    now: InputSnapshot,
    last: InputSnapshot,
    seconds: f64,
) -> DiagnosticStatus {
    let rate_hz = (now.received - last.received) as f64 / seconds;
    // `lost` may decrease when a message counted as lost arrives late.
    let bad = (now.lost - last.lost.min(now.lost))
        + (now.malformed - last.malformed)
        + (now.overrun - last.overrun);
    let (level, message) = match () {
        () if bad > 0 => (WARN, format!("{bad} messages lost, malformed or dropped since the last report")),
        // Not an error, as topics may start later than the node.
        () if now.received == 0 => (STALE, "nothing came yet".into()),
        () => (OK, format!("{rate_hz:.1} Hz")),
    };
    let values = [
        ("topic", input.topic.clone()),
        ("rate_hz", format!("{rate_hz:.2}")),
        ("received", now.received.to_string()),
        ("lost", now.lost.to_string()),
        ("malformed", now.malformed.to_string()),
        ("dropped_busy", now.overrun.to_string()),
    ];
    status_of_part(node, input.role, level, message, &values)
}

fn status_of_part(
    node: &str,
    part: &str,
    level: u8,
    message: String,
    values: &[(&str, String)],
) -> DiagnosticStatus {
    let values = values.iter().map(|(key, value)| KeyValue { key: (*key).to_owned(), value: value.clone() });
    DiagnosticStatus {
        level,
        name: format!("{node}: {part}"),
        message,
        hardware_id: "artitwin".into(),
        values: values.collect(),
    }
}

/// Resident memory of the process, bytes.
#[must_use]
pub(crate) fn resident_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("VmRSS:"))?;
    line.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::input_count::InputCount;

    #[test]
    fn rates_and_losses_are_those_since_the_last_report() {
        let count = Arc::new(InputCount::default());
        let input = Input { role: "color", topic: "/c".into(), count: Arc::clone(&count) };
        let mut diagnostics = Diagnostics::new("/artitwin", vec![input]);
        let mut report = |secs| {
            diagnostics
                .status_array(Time::default(), Duration::from_secs(secs), &Snapshot::default())
                .status
                .swap_remove(0)
        };
        assert_eq!(report(1).level, STALE);
        (1..=60).for_each(|s| count.count_received([0; 16], s));
        let status = report(2);
        assert_eq!((status.level, status.message.as_str()), (OK, "30.0 Hz"));
        count.count_received([0; 16], 63);
        let status = report(1);
        assert_eq!(status.level, WARN);
        let lost = status.values.iter().find(|v| v.key == "lost").unwrap();
        assert_eq!(lost.value, "2");
        assert_eq!(report(1).level, OK);
    }

    #[test]
    fn memory_is_known_on_linux() {
        if cfg!(target_os = "linux") {
            assert!(resident_bytes().unwrap() > 1 << 20);
        }
    }
}
