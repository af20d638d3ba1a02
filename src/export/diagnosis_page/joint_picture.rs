//! Draws a joint: its links, its axis, and the recorded range.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use nalgebra::{Point2, Point3, Unit, Vector3};

use super::{
    solids::{Solid, box_of_inertia, cuboid, face_normal},
    view::View,
    words::position_text,
};
use gap::twin_tree::{Motion, TwinTree};
use geometry::Pose;
use model::escape_xml;
use surface::hull_2d;

/// Width and height of the drawing. chosen: for the eye
const SIZE: (f64, f64) = (620.0, 440.0);
/// Border for labels. chosen: for the eye
const BORDER: f64 = 50.0;
/// Points of an arc.
const ARC: usize = 64;
/// Side of the block that stands for a parent without a shape, as a share of the moved part.
/// chosen: for the eye
const BLOCK: f64 = 0.08;
/// Least length of the drawn axis on either side, and its length beyond the moved part, as shares of that
/// part's size. chosen: for the eye
const AXIS: (f64, f64) = (0.4, 0.18);
/// Distance at which a slide's travel is drawn below the part, as a share of the part's height. chosen: for
/// the eye
const BELOW: f64 = 1.2;
/// Width of a letter of the labels. chosen: the width in usual fonts
const LETTER: f64 = 6.6;
/// A shape smaller than this share of its distance from the joint is drawn as a point mass on a rod.
/// chosen: for the eye
const SMALL: f64 = 0.25;

/// What is needed to draw a joint.
pub(super) struct DrawnJoint<'a> {
    /// The twin.
    pub tree: &'a TwinTree,
    /// Index of the joint.
    pub joint: usize,
    /// Shapes by link.
    pub visuals: &'a BTreeMap<String, Vec<Solid>>,
    /// Lowest and highest recorded position.
    pub range: (f64, f64),
    /// Positions of all joints, in the order of the tree; that of the drawn joint is ignored.
    pub others: &'a [f64],
}

/// A face projected on the sheet.
struct Face {
    corners: Vec<(f64, f64)>,
    depth: f64,
    style: String,
}

// Writing to a string cannot fail: the results below are dropped.

impl DrawnJoint<'_> {
    /// Poses of all links with the joint at a position.
    fn poses_at(&self, q: f64) -> Vec<Pose> {
        let mut all = self.others.to_vec();
        all[self.joint] = q;
        self.tree.link_poses(&all)
    }

    fn is_moved(&self, link: usize) -> bool {
        self.tree.carries(self.joint, link)
    }

    /// Shapes of a link: those of the twin, else the box of its mass and inertia.
    fn link_shapes(&self, link: usize) -> Vec<Solid> {
        let link = &self.tree.links[link];
        match self.visuals.get(&link.name) {
            Some(shapes) if !shapes.is_empty() => shapes.clone(),
            _ => box_of_inertia(link).into_iter().collect(),
        }
    }

    /// Corners of all moved links with the joint at a position.
    fn moved_corners(&self, q: f64) -> Vec<Point3<f64>> {
        let poses = self.poses_at(q);
        let links = (0..poses.len()).filter(|l| self.is_moved(*l));
        links
            .flat_map(|l| {
                let corners = self.link_shapes(l).into_iter().flat_map(|s| s.faces).flatten();
                let center = self.tree.links[l].center_of_mass;
                corners.chain([center]).map(|p| poses[l] * p).collect::<Vec<_>>()
            })
            .collect()
    }

    /// Origin and axis in the root's frame.
    fn axis_in_root(&self) -> (Point3<f64>, Unit<Vector3<f64>>) {
        let joint = &self.tree.joints[self.joint];
        let frame = self.poses_at(0.0)[joint.child];
        (Point3::from(frame.translation.vector), frame.rotation * joint.axis)
    }

    /// The point of the moved part whose path is drawn, at position 0: as far from the axis as the part
    /// reaches, at the height of its center of mass.
    fn tracer_point(&self, origin: &Point3<f64>, axis: &Unit<Vector3<f64>>) -> Point3<f64> {
        let poses = self.poses_at(0.0);
        let links: Vec<usize> = (0..poses.len()).filter(|l| self.is_moved(*l)).collect();
        let mass: f64 = links.iter().map(|l| self.tree.links[*l].mass_kg).sum();
        let weighted = links
            .iter()
            .map(|l| (poses[*l] * self.tree.links[*l].center_of_mass).coords * self.tree.links[*l].mass_kg);
        let center = weighted.sum::<Vector3<f64>>() / mass.max(1e-300);
        let arm = across_axis(axis, &(center - origin.coords));
        if self.tree.joints[self.joint].motion == Motion::Slide {
            return Point3::from(center);
        }
        let corners = self.moved_corners(0.0);
        let reach = corners.iter().map(|p| across_axis(axis, &(p - origin)).norm()).fold(0.0, f64::max);
        let way = arm.try_normalize(1e-3 * reach).unwrap_or_else(|| {
            let far = corners.iter().map(|p| across_axis(axis, &(p - origin)));
            let far = far.max_by(|a, b| a.norm().total_cmp(&b.norm())).unwrap_or_else(Vector3::x);
            far.try_normalize(0.0).unwrap_or_else(Vector3::x)
        });
        origin + axis.into_inner() * axis.dot(&(center - origin.coords)) + way * reach
    }

    /// A point of a slide, shifted on the sheet to below the part, where nothing hides its path.
    fn point_below(&self, point: Point3<f64>, axis: &Unit<Vector3<f64>>, view: &View) -> Point3<f64> {
        let down = view.sheet_down() - axis.into_inner() * axis.dot(&view.sheet_down());
        let Some(down) = down.try_normalize(1e-6) else { return point };
        let corners = self.moved_corners(0.0);
        let depth = corners.iter().map(|p| down.dot(&(p - point))).fold(0.0, f64::max);
        point + down * (BELOW * depth)
    }

    /// The drawing, as SVG.
    pub(super) fn svg_drawing(&self) -> String {
        let joint = &self.tree.joints[self.joint];
        let (origin, axis) = self.axis_in_root();
        let (low, high) = self.range;
        let shown = 0.5 * (low + high);
        let tracer = self.tracer_point(&origin, &axis);
        let reach = (tracer - origin).norm().max(1e-6);
        let size = self.moved_corners(shown).iter().map(|p| (p - origin).norm()).fold(reach, f64::max);
        let arm = self.motion_along(&origin, &axis, shown) * tracer - origin;
        let view = View::best_view(joint.motion, &axis, &arm, &self.tree.gravity);
        let tracer =
            if joint.motion == Motion::Slide { self.point_below(tracer, &axis, &view) } else { tracer };
        let along = self.moved_corners(shown).into_iter().map(|p| axis.dot(&(p - origin)));
        let (least, most) = along.fold((0.0f64, 0.0f64), |(l, h), x| (l.min(x), h.max(x)));
        let least = least.min((AXIS.1 - AXIS.0) * size);
        let most = most.max((AXIS.0 - AXIS.1) * size);
        let ends = [least - AXIS.1 * size, most + AXIS.1 * size].map(|x| origin + axis.into_inner() * x);
        let sweep: Vec<Point3<f64>> = (0..=ARC)
            .map(|i| self.motion_along(&origin, &axis, low + (high - low) * i as f64 / ARC as f64) * tracer)
            .collect();
        let mut seen: Vec<Point3<f64>> = sweep.iter().copied().chain(ends).chain([origin]).collect();
        for q in [low, shown, high] {
            seen.extend(self.moved_corners(q));
        }
        let still = self.static_shapes(size);
        seen.extend(still.iter().flat_map(|(_, s)| s.faces.iter().flatten()));
        let view = view.fitted_to(&seen, SIZE, BORDER);
        let mut svg = format!(
            "<svg class=\"joint\" viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"the joint {}\">\n",
            SIZE.0,
            SIZE.1,
            escape_xml(&joint.name)
        );
        self.push_bodies(&mut svg, &view, &still, shown);
        for q in [low, high] {
            self.push_ghost(&mut svg, &view, q);
        }
        self.push_sweep(&mut svg, &view, &sweep, &tracer);
        push_axis(&mut svg, &view, ends, &joint.name);
        push_directions(&mut svg, &view, &self.tree.gravity);
        svg.push_str("</svg>");
        svg
    }

    /// Motion of the moved part from position 0 to another position, in the root's frame.
    fn motion_along(&self, origin: &Point3<f64>, axis: &Unit<Vector3<f64>>, q: f64) -> Pose {
        match self.tree.joints[self.joint].motion {
            Motion::Turn => {
                Pose::rotation_wrt_point(nalgebra::UnitQuaternion::from_axis_angle(axis, q), *origin)
            }
            Motion::Slide | Motion::Fixed => Pose::from(axis.into_inner() * q),
        }
    }

    /// Shapes of the static links, in the root's frame; a block for a parent without shapes.
    fn static_shapes(&self, size: f64) -> Vec<(usize, Solid)> {
        let poses = self.poses_at(0.0);
        let parent = self.tree.joints[self.joint].parent;
        let frame = self.poses_at(0.0)[self.tree.joints[self.joint].child];
        let mut all = Vec::new();
        for link in (0..poses.len()).filter(|l| !self.is_moved(*l)) {
            let shapes = self.link_shapes(link);
            if shapes.is_empty() && link == parent {
                all.push((link, placed_solid(cuboid(Vector3::repeat(BLOCK * size)), &frame)));
            }
            all.extend(shapes.into_iter().map(|s| (link, placed_solid(s, &poses[link]))));
        }
        all
    }

    fn push_bodies(&self, svg: &mut String, view: &View, still: &[(usize, Solid)], shown: f64) {
        let poses = self.poses_at(shown);
        let mut faces = Vec::new();
        for (_, solid) in still {
            faces.extend(visible_faces(solid, view, [196.0, 202.0, 209.0]));
        }
        for link in (0..poses.len()).filter(|l| self.is_moved(*l)) {
            let shapes = self.link_shapes(link);
            self.push_rod(svg, view, link, &poses, &shapes);
            for solid in shapes {
                faces.extend(visible_faces(&placed_solid(solid, &poses[link]), view, [150.0, 186.0, 228.0]));
            }
        }
        // The farthest first: nearer faces cover them.
        faces.sort_by(|a, b| a.depth.total_cmp(&b.depth));
        for face in faces {
            writeln!(svg, "<path {} d=\"{}Z\"/>", face.style, line_path(&face.corners)).ok();
        }
    }

    /// Draws a rod from the joint of a link to its mass.
    fn push_rod(&self, svg: &mut String, view: &View, link: usize, poses: &[Pose], shapes: &[Solid]) {
        let center = self.tree.links[link].center_of_mass;
        let extent = shapes
            .iter()
            .flat_map(|s| s.faces.iter().flatten())
            .map(|p| (p - center).norm())
            .fold(0.0, f64::max);
        if extent < SMALL * center.coords.norm() || shapes.is_empty() {
            let ends =
                [poses[link] * Point3::origin(), poses[link] * center].map(|p| view.point_on_sheet(&p));
            writeln!(svg, "<path class=\"rod\" d=\"{}\"/>", line_path(&ends)).ok();
            if self.tree.links[link].mass_kg > 0.0 {
                let (x, y) = ends[1];
                let look = "r=\"7\" fill=\"#96bae4\" stroke=\"#5b6776\"";
                writeln!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" {look}/>").ok();
            }
        }
    }

    /// Draws the outline of the moved part at a position.
    fn push_ghost(&self, svg: &mut String, view: &View, q: f64) {
        let poses = self.poses_at(q);
        for link in (0..poses.len()).filter(|l| self.is_moved(*l)) {
            let shapes = self.link_shapes(link);
            let center = self.tree.links[link].center_of_mass;
            let mut corners: Vec<Point3<f64>> =
                shapes.iter().flat_map(|s| s.faces.iter().flatten().copied()).collect();
            let extent = corners.iter().map(|p| (p - center).norm()).fold(0.0, f64::max);
            if extent < SMALL * center.coords.norm() {
                corners.extend([Point3::origin(), center]);
            }
            let paper: Vec<Point2<f64>> = corners
                .iter()
                .map(|p| Point2::from(<[f64; 2]>::from(view.point_on_sheet(&(poses[link] * p)))))
                .collect();
            let outline: Vec<(f64, f64)> = hull_2d(&paper).iter().map(|p| (p.x, p.y)).collect();
            writeln!(svg, "<path class=\"ghost\" d=\"{}Z\"/>", line_path(&outline)).ok();
        }
    }

    /// Draws the path of the tracer, its ends and its zero.
    fn push_sweep(&self, svg: &mut String, view: &View, sweep: &[Point3<f64>], tracer: &Point3<f64>) {
        let turns = self.tree.joints[self.joint].motion == Motion::Turn;
        let (low, high) = self.range;
        let (origin, axis) = self.axis_in_root();
        let paper: Vec<(f64, f64)> = sweep.iter().map(|p| view.point_on_sheet(p)).collect();
        writeln!(svg, "<path class=\"sweep\" d=\"{}\"/>", line_path(&paper)).ok();
        push_head(svg, paper[ARC - 2], paper[ARC], "sweep-head");
        let foot = origin + axis.into_inner() * axis.dot(&(sweep[0] - origin));
        let middle = view.point_on_sheet(if turns { &foot } else { &sweep[ARC / 2] });
        let mut named = vec![(low, position_text(low, turns)), (high, position_text(high, turns))];
        // Close to an end, its label would cover the other one.
        if low + 0.12 * (high - low) < 0.0 && high - 0.12 * (high - low) > 0.0 {
            named.push((0.0, "0".into()));
        }
        for (q, text) in named {
            let end = view.point_on_sheet(&(self.motion_along(&origin, &axis, q) * tracer));
            if turns {
                writeln!(
                    svg,
                    "<path class=\"ray\" d=\"{}\"/>",
                    line_path(&[view.point_on_sheet(&foot), end])
                )
                .ok();
            }
            push_range_name(svg, end, middle, &text);
        }
    }
}

/// Writes a name at a point of the path, on the side away from its middle.
fn push_range_name(svg: &mut String, end: (f64, f64), middle: (f64, f64), text: &str) {
    let away = (end.0 - middle.0, end.1 - middle.1);
    let norm = away.0.hypot(away.1).max(1.0);
    let x = end.0 + 14.0 * away.0 / norm;
    let y = end.1 + 14.0 * away.1 / norm + 4.0;
    let class = match away.0 / norm {
        x if x > 0.4 => "",
        x if x < -0.4 => "end",
        _ => "mid",
    };
    let x = text_position(x, class, text.chars().count());
    let class = format!("range-name {class}");
    writeln!(svg, "<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\">{text}</text>").ok();
}

/// The component of a vector perpendicular to an axis.
fn across_axis(axis: &Unit<Vector3<f64>>, v: &Vector3<f64>) -> Vector3<f64> {
    v - axis.into_inner() * axis.dot(v)
}

fn placed_solid(solid: Solid, pose: &Pose) -> Solid {
    let faces = solid.faces.into_iter().map(|f| f.into_iter().map(|p| pose * p).collect()).collect();
    Solid { faces, ..solid }
}

/// Visible faces of a solid, lit from the viewer's upper left.
fn visible_faces(solid: &Solid, view: &View, color: [f64; 3]) -> Vec<Face> {
    let mut faces = Vec::new();
    for face in solid.faces.iter().filter(|face| face_normal(face).dot(&view.toward) > 0.0) {
        let light =
            view.light_direction().dot(&face_normal(face).try_normalize(0.0).unwrap_or_else(Vector3::zeros));
        let shade = 0.74 + 0.26 * light.max(0.0);
        let [r, g, b] = color.map(|c| (c * shade + 30.0 * light.max(0.0)).min(255.0) as u8);
        // A round solid shows neither edges nor gaps between its faces.
        let edge = if solid.has_edges { "#5b6776".to_owned() } else { format!("rgb({r} {g} {b})") };
        faces.push(Face {
            corners: face.iter().map(|p| view.point_on_sheet(p)).collect(),
            depth: face.iter().map(|p| view.toward.dot(&p.coords)).sum::<f64>() / face.len() as f64,
            style: format!("style=\"fill: rgb({r} {g} {b}); stroke: {edge}; stroke-width: 0.8\""),
        });
    }
    faces
}

fn line_path(points: &[(f64, f64)]) -> String {
    let mut path = String::new();
    for (i, (x, y)) in points.iter().enumerate() {
        write!(path, "{}{x:.1} {y:.1}", if i == 0 { 'M' } else { 'L' }).ok();
    }
    path
}

/// The head of an arrow at `to`.
fn push_head(svg: &mut String, from: (f64, f64), to: (f64, f64), class: &str) {
    let dx = to.0 - from.0;
    let dy = to.1 - from.1;
    let norm = dx.hypot(dy);
    if norm < 1e-6 {
        return;
    }
    let x = dx / norm;
    let y = dy / norm;
    let corner = |side: f64| (to.0 - 10.0 * x - side * 4.5 * y, to.1 - 10.0 * y + side * 4.5 * x);
    writeln!(svg, "<path class=\"{class}\" d=\"{}Z\"/>", line_path(&[to, corner(1.0), corner(-1.0)])).ok();
}

/// Position at which a text of this many letters stays on the sheet.
fn text_position(x: f64, anchor: &str, letters: usize) -> f64 {
    let width = LETTER * letters as f64;
    match anchor {
        "end" => x.max(width),
        "mid" => x.clamp(0.5 * width, (SIZE.0 - 0.5 * width).max(0.5 * width)),
        _ => x.min(SIZE.0 - width),
    }
}

/// Draws the axis with its name.
fn push_axis(svg: &mut String, view: &View, ends: [Point3<f64>; 2], name: &str) {
    let [from, to] = ends.map(|p| view.point_on_sheet(&p));
    writeln!(svg, "<path class=\"axis-of\" d=\"{}\"/>", line_path(&[from, to])).ok();
    push_head(svg, from, to, "head");
    let short: String = name.chars().take(28).collect();
    // Beyond the tip, in the direction of the arrow.
    let dx = to.0 - from.0;
    let dy = to.1 - from.1;
    let norm = dx.hypot(dy).max(1.0);
    let class = if dx / norm > 0.4 {
        ""
    } else if dx / norm < -0.4 {
        "end"
    } else {
        "mid"
    };
    let x = text_position(to.0 + 8.0 * dx / norm, class, short.chars().count());
    writeln!(
        svg,
        "<text class=\"axis-name {class}\" x=\"{x:.1}\" y=\"{:.1}\">{}</text>",
        (to.1 + 12.0 * dy / norm + 2.0).max(12.0),
        escape_xml(&short)
    )
    .ok();
}

/// The root's axes and gravity, in the lower left corner.
fn push_directions(svg: &mut String, view: &View, gravity: &Vector3<f64>) {
    let foot = (46.0, SIZE.1 - 40.0);
    for (way, text) in [(Vector3::x(), "x"), (Vector3::y(), "y"), (Vector3::z(), "z")] {
        push_direction(svg, foot, view.direction_on_sheet(&way), text);
    }
    if let Some(down) = gravity.try_normalize(1e-9) {
        let foot = (SIZE.0 - 24.0, SIZE.1 - 62.0);
        let tip = push_direction(svg, foot, view.direction_on_sheet(&down), "g");
        push_head(svg, foot, tip, "head");
    }
}

/// A line from `foot` in a direction on the sheet, with its name; returns its tip.
fn push_direction(svg: &mut String, foot: (f64, f64), direction: (f64, f64), name: &str) -> (f64, f64) {
    let (x, y) = direction;
    let tip = (foot.0 + 26.0 * x, foot.1 + 26.0 * y);
    writeln!(svg, "<path class=\"thin\" d=\"{}\"/>", line_path(&[foot, tip])).ok();
    let x = foot.0 + 36.0 * x;
    let y = foot.1 + 36.0 * y + 4.0;
    writeln!(svg, "<text class=\"mid\" x=\"{x:.1}\" y=\"{y:.1}\">{name}</text>").ok();
    tip
}
