//! Checks a model for defects that keep a simulator from loading it, or make it load a different one.

use std::collections::BTreeSet;

use nalgebra::{Matrix3, SymmetricEigen};

use super::{ArticulatedModel, Inertial, Joint, is_plain_name};
use surface::TriangleMesh;

/// Relative tolerance of the inertia checks: URDF text keeps nine digits.
/// chosen: a thousand times the rounding of the text
const INERTIA_SLACK: f64 = 1e-6;
/// Principal moments of this size are rounding, kg m^2.
/// chosen: the moment of a microgram at 1 mm; tools that turn tensors leave 1e-20
const INERTIA_ROUNDING: f64 = 1e-15;
/// How far an observed position may lie outside a limit, radians or meters.
/// chosen: above rounding, below any reading
const LIMIT_SLACK: f64 = 1e-9;

/// A defect of a model. A model with any is not exported.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// The link, joint or model it is about.
    pub subject: String,
    /// The defect, with the numbers.
    pub message: String,
}

impl std::fmt::Display for Finding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.subject, self.message)
    }
}

/// All defects of a model, in the order of its links and joints; empty if the model can be exported.
///
/// Checks names (`[A-Za-z][A-Za-z0-9_]*`, unique over links and joints together), meshes (not empty, finite,
/// indices inside), masses (positive), inertia tensors (symmetric, positive, `A + B >= C`), axes (unit),
/// limits (finite, lower below upper, around the observed positions), the tree (every link reached from link
/// 0 by one chain) and the states.
pub fn validate(model: &ArticulatedModel) -> Vec<Finding> {
    let mut found = Findings::default();
    check_names(model, &mut found);
    for link in &model.links {
        check_mesh(&link.name, &link.visual, &mut found);
        check_inertial(&link.name, &link.inertial, &mut found);
    }
    for joint in &model.joints {
        check_joint(joint, &mut found);
    }
    check_tree(model, &mut found);
    check_states(model, &mut found);
    found.0
}

#[derive(Default)]
struct Findings(Vec<Finding>);

impl Findings {
    fn add_finding(&mut self, subject: &str, message: impl Into<String>) {
        self.0.push(Finding { subject: subject.to_owned(), message: message.into() });
    }
}

fn check_names(model: &ArticulatedModel, found: &mut Findings) {
    // Links and joints together: USD and MJCF need one name each.
    let all = model.links.iter().map(|l| &l.name).chain(model.joints.iter().map(|j| &j.name));
    let mut seen = BTreeSet::new();
    for name in std::iter::once(&model.name).chain(all.clone()) {
        if !is_plain_name(name) {
            found.add_finding(
                name,
                "the name must be letters, digits and _, begin with a letter and have 64 characters at most",
            );
        }
    }
    for name in all {
        // File systems may ignore case, and a link's name becomes a file name.
        if !seen.insert(name.to_ascii_lowercase()) {
            found.add_finding(name, "the name is used twice among links and joints (case ignored)");
        }
    }
}

fn check_mesh(subject: &str, mesh: &TriangleMesh, found: &mut Findings) {
    if mesh.is_empty() {
        found.add_finding(subject, "the mesh has no triangle");
    }
    if let Some(i) = mesh.vertices.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
        found.add_finding(subject, format!("vertex {i} of the mesh is not finite"));
    }
    let count = mesh.vertices.len();
    if let Some(i) = mesh.triangles.iter().position(|t| t.iter().any(|&v| v as usize >= count)) {
        found.add_finding(
            subject,
            format!("triangle {i} of the mesh names a vertex beyond the last of {count}"),
        );
    }
    if !mesh.colors.is_empty() && mesh.colors.len() != count {
        found.add_finding(subject, format!("the mesh has {} colors for {count} vertices", mesh.colors.len()));
    }
}

fn check_inertial(subject: &str, inertial: &Inertial, found: &mut Findings) {
    let Inertial { mass_kg, center_of_mass, inertia, .. } = inertial;
    if !(mass_kg.is_finite() && *mass_kg > 0.0) {
        found.add_finding(subject, format!("the mass is {mass_kg} kg; it must be positive"));
    }
    if !center_of_mass.iter().all(|x| x.is_finite()) {
        found.add_finding(subject, "the center of mass is not finite");
    }
    if !inertia.iter().all(|x| x.is_finite()) {
        found.add_finding(subject, "the inertia is not finite");
        // The rules below compute with these numbers.
        return;
    }
    let scale = inertia.norm();
    if (inertia - inertia.transpose()).norm() > INERTIA_SLACK * scale {
        found.add_finding(subject, "the inertia is not symmetric");
    }
    if let Some(why) = impossible_inertia(inertia) {
        found.add_finding(subject, why);
    } else if principal_moments(inertia)[0] <= 0.0 {
        found.add_finding(subject, "the inertia has the principal moment 0 kg m^2; all must be positive");
    }
}

/// Why an inertia is impossible for any finite body: a principal moment is negative, or larger than the other
/// two together; `None` if it is possible. A moment of 0 belongs to a point or a rod.
pub fn impossible_inertia(inertia: &Matrix3<f64>) -> Option<String> {
    if inertia_excess(inertia) == 0.0 {
        return None;
    }
    let [a, b, c] = principal_moments(inertia);
    Some(if a < -rounding_of_moment(c) {
        format!("the principal moment {a:.3e} kg m^2 is not positive")
    } else {
        format!("the principal moments {a:.3e}, {b:.3e}, {c:.3e} kg m^2 break A + B >= C")
    })
}

/// By how much a finite tensor misses that of a body, kg m^2: how far its least principal moment lies below
/// 0, or its largest above the sum of the others; 0 if a body can have it.
#[must_use]
pub fn inertia_excess(inertia: &Matrix3<f64>) -> f64 {
    let [a, b, c] = principal_moments(inertia);
    let excess = (-a).max(c - a - b);
    if excess > rounding_of_moment(c) { excess } else { 0.0 }
}

/// What is rounding beside the largest principal moment of a tensor, kg m^2.
fn rounding_of_moment(largest: f64) -> f64 {
    (INERTIA_SLACK * largest.abs()).max(INERTIA_ROUNDING)
}

/// Principal moments of a finite tensor in rising order.
pub fn principal_moments(inertia: &Matrix3<f64>) -> [f64; 3] {
    // The solver reads one half of the tensor.
    let mut m: [f64; 3] = SymmetricEigen::new(0.5 * (inertia + inertia.transpose())).eigenvalues.into();
    m.sort_by(f64::total_cmp);
    m
}

fn check_joint(joint: &Joint, found: &mut Findings) {
    let axis = joint.axis.as_ref();
    // Comparisons are negated, here and below: NaN fails them.
    if !((axis.norm() - 1.0).abs() < 1e-6) {
        found.add_finding(&joint.name, format!("the axis has length {}; it must be 1", axis.norm()));
    }
    let pose = &joint.parent_from_joint;
    if !(pose.translation.vector.iter().all(|x| x.is_finite()) && (pose.rotation.norm() - 1.0).abs() < 1e-6) {
        found.add_finding(&joint.name, "the origin is not a rigid transform");
    }
    let l = &joint.limit;
    if !(l.lower.is_finite() && l.upper.is_finite() && l.lower < l.upper) {
        found.add_finding(&joint.name, format!("the limits [{}, {}] are not an interval", l.lower, l.upper));
    }
    for (what, value) in [("effort", l.effort), ("velocity", l.velocity)] {
        if !(value.is_finite() && value > 0.0) {
            found.add_finding(&joint.name, format!("the {what} limit is {value}; it must be positive"));
        }
    }
}

fn check_tree(model: &ArticulatedModel, found: &mut Findings) {
    let n = model.links.len();
    if n == 0 {
        found.add_finding(&model.name, "the model has no link");
        return;
    }
    let mut parent = vec![None; n];
    for joint in &model.joints {
        if joint.parent >= n || joint.child >= n {
            found
                .add_finding(&joint.name, format!("joins links {} and {} of {n}", joint.parent, joint.child));
            // The rules below use these as indices.
            return;
        }
        if parent[joint.child].replace(joint.parent).is_some() {
            found.add_finding(
                &joint.name,
                format!("link {} is already the child of another joint", model.links[joint.child].name),
            );
        }
    }
    if parent[0].is_some() {
        found.add_finding(&model.links[0].name, "link 0 must be the root, but it is the child of a joint");
    }
    for (i, link) in model.links.iter().enumerate().skip(1) {
        // A loop has no end, and no chain is longer than all links.
        let chain = std::iter::successors(Some(i), |&k| parent[k]).take(n);
        if chain.last() != Some(0) {
            found.add_finding(&link.name, "the link is not connected to the root");
        }
    }
}

fn check_states(model: &ArticulatedModel, found: &mut Findings) {
    if model.states.is_empty() {
        found.add_finding(&model.name, "the model has no observed state");
    }
    for (k, positions) in model.states.iter().enumerate() {
        if positions.len() != model.joints.len() {
            found.add_finding(
                &model.name,
                format!("state {k} has {} positions for {} joints", positions.len(), model.joints.len()),
            );
            continue;
        }
        for (q, joint) in positions.iter().zip(&model.joints) {
            let l = &joint.limit;
            if !(*q >= l.lower - LIMIT_SLACK && *q <= l.upper + LIMIT_SLACK) {
                found.add_finding(
                    &joint.name,
                    format!("position {q} in state {k} is outside the limits [{}, {}]", l.lower, l.upper),
                );
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::example::cabinet;
    use nalgebra::Unit;

    /// Breaks a sound model and returns what is said about it.
    fn findings(break_it: impl FnOnce(&mut ArticulatedModel)) -> String {
        let mut model = cabinet();
        break_it(&mut model);
        validate(&model).iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
    }

    #[test]
    fn a_sound_model_has_no_finding() {
        assert_eq!(findings(|_| {}), "");
    }

    #[test]
    fn every_defect_is_found_and_named() {
        let cases: [(&str, fn(&mut ArticulatedModel)); 21] = [
            ("door: the mass is 0 kg", |m| m.links[1].inertial.mass_kg = 0.0),
            ("door: the mass is NaN kg", |m| m.links[1].inertial.mass_kg = f64::NAN),
            ("break A + B >= C", |m| {
                m.links[0].inertial.inertia = Matrix3::from_diagonal(&[1.0, 1.0, 2.5].into())
            }),
            ("principal moment -1.000e0", |m| {
                m.links[0].inertial.inertia = Matrix3::from_diagonal(&[-1.0, 1.0, 1.0].into())
            }),
            ("not symmetric", |m| m.links[0].inertial.inertia[(0, 1)] = 0.5),
            ("inertia is not finite", |m| m.links[0].inertial.inertia[(2, 2)] = f64::INFINITY),
            ("has length 2", |m| m.joints[0].axis = Unit::new_unchecked([0.0, 0.0, 2.0].into())),
            ("has length NaN", |m| m.joints[0].axis = Unit::new_unchecked([f64::NAN, 0.0, 0.0].into())),
            ("are not an interval", |m| m.joints[1].limit.upper = m.joints[1].limit.lower),
            ("effort limit is 0", |m| m.joints[1].limit.effort = 0.0),
            ("is already the child", |m| m.joints[1].child = 1),
            ("drawer: the link is not connected", |m| m.joints[1].parent = 2),
            ("joins links 0 and 7 of 3", |m| m.joints[1].child = 7),
            ("link 0 must be the root", |m| (m.joints[0].parent, m.joints[0].child) = (1, 0)),
            ("Door: the name is used twice", |m| m.joints[1].name = "Door".into()),
            ("my door: the name must be", |m| m.links[1].name = "my door".into()),
            ("drawer: the mesh has no triangle", |m| m.links[2].visual.triangles.clear()),
            ("vertex 3 of the mesh is not finite", |m| m.links[2].visual.vertices[3].y = f32::NAN),
            ("names a vertex beyond", |m| m.links[2].visual.triangles[0][1] = 99),
            ("state 1 has 1 positions for 2 joints", |m| m.states[1].truncate(1)),
            ("position 9 in state 0 is outside", |m| m.states[0][0] = 9.0),
        ];
        for (expected, break_it) in cases {
            let text = findings(break_it);
            assert!(text.contains(expected), "expected '{expected}' in '{text}'");
        }
    }
}
