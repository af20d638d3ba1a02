//! Adds positions from poses and efforts from wrenches to the joint states of a run.

use std::collections::BTreeMap;

use crate::{
    record::{
        drive::Hold,
        off_axis::{OffAxis, posed_joint},
        recording::{JointSamples, Recording},
        tracks::{PoseTrack, TrackError, joint_efforts, resampled},
    },
    twin_tree::{Motion, TwinTree},
};

/// Sets positions of joints from poses, where requested or where nothing else reports them, and adds the
/// efforts of wrenches to the recorded ones. Returns the off-axis evidence of the poses, by joint.
///
/// # Errors
/// [`TrackError`] for links and frames missing in the twin.
pub fn complete_run(
    run: &mut Recording,
    tree: &TwinTree,
    hold: Hold,
) -> Result<BTreeMap<usize, OffAxis>, TrackError> {
    let mut evidence = BTreeMap::new();
    let moving: Vec<usize> =
        (0..tree.joints.len()).filter(|&j| tree.joints[j].motion != Motion::Fixed).collect();
    let asked: Vec<&PoseTrack> = run.poses.iter().filter(|p| p.asked).collect();
    let mut from_poses = BTreeMap::new();
    for &j in &moving {
        let known = run.samples(&tree.joints[j].name).is_some_and(JointSamples::has_positions);
        let tracks: Vec<&PoseTrack> = if known { asked.clone() } else { run.poses.iter().collect() };
        if let Some(found) = posed_joint(tree, j, &tracks)? {
            evidence.insert(j, found.evidence);
            from_poses.insert(j, found);
        }
    }
    for (j, found) in from_poses {
        let name = &tree.joints[j].name;
        let old = run.samples(name);
        let effort = old.map(|s| {
            let usable: Vec<usize> = (0..s.time_s.len()).filter(|&k| s.effort[k].is_finite()).collect();
            let of = |values: &[f64]| usable.iter().map(|&k| values[k]).collect::<Vec<f64>>();
            resampled(&of(&s.time_s), &of(&s.effort), &found.time_s, hold)
        });
        // NaN unless a wrench gives the effort below.
        let effort = effort.unwrap_or_else(|| vec![f64::NAN; found.time_s.len()]);
        let velocity = vec![f64::NAN; found.time_s.len()];
        let name = name.clone();
        let time_s = found.time_s;
        let position = found.position;
        let samples = JointSamples { name, time_s, position, effort, velocity };
        run.joints.retain(|s| s.name != samples.name);
        run.joints.push(samples);
    }
    // Replaced joints were appended; sorting makes the order independent of this.
    run.joints.sort_by(|a, b| a.name.cmp(&b.name));
    let mut added: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
    // An unrecorded joint is assumed at 0.
    let position = |j: usize, t: f64| run.samples(&tree.joints[j].name).map_or(0.0, |s| position_at(s, t));
    for track in &run.wrenches {
        for (j, efforts) in joint_efforts(tree, track, &position)?.into_iter().enumerate() {
            let (Some(efforts), Some(samples)) = (efforts, run.samples(&tree.joints[j].name)) else {
                continue;
            };
            let own = resampled(&track.time_s, &efforts, &samples.time_s, hold);
            let sum = added.entry(j).or_insert_with(|| vec![0.0; own.len()]);
            sum.iter_mut().zip(&own).for_each(|(sum, own)| *sum += own);
        }
    }
    for (j, added) in added {
        let name = &tree.joints[j].name;
        let Some(samples) = run.joints.iter_mut().find(|s| s.name == *name) else { continue };
        // A recorded effort acts in addition to the wrench.
        let drives = samples.effort.iter().any(|u| u.is_finite());
        for (effort, added) in samples.effort.iter_mut().zip(&added) {
            *effort = if drives { *effort + added } else { *added };
        }
    }
    Ok(evidence)
}

/// Position of a joint at a time, linear between samples, constant beyond the ends.
fn position_at(samples: &JointSamples, t: f64) -> f64 {
    let known = |k: &usize| samples.position[*k].is_finite();
    let next = samples.time_s.partition_point(|x| *x < t);
    let after = (next..samples.time_s.len()).find(known);
    let before = (0..next.min(samples.time_s.len())).rev().find(known);
    match (before, after) {
        (Some(a), Some(b)) => {
            let share = (t - samples.time_s[a]) / (samples.time_s[b] - samples.time_s[a]).max(1e-12);
            samples.position[a] * (1.0 - share) + samples.position[b] * share
        }
        (Some(k), None) | (None, Some(k)) => samples.position[k],
        (None, None) => 0.0,
    }
}
