//! Meshes that lack a piece.

use std::{fs, path::Path};

use nalgebra::Point3;

/// Takes away what lies in the outer third of a mesh along its longest side.
pub fn cut(from: &Path, to: &Path) {
    let text = fs::read_to_string(from).unwrap();
    let first = |n: &str| n.split('/').next().unwrap().parse::<f64>().unwrap();
    let numbers = |l: &str| l.split(' ').skip(1).map(first).collect::<Vec<_>>();
    let points: Vec<Point3<f64>> =
        text.lines().filter(|l| l.starts_with("v ")).map(|l| Point3::from_slice(&numbers(l))).collect();
    let mut open: Vec<[Point3<f64>; 3]> = text
        .lines()
        .filter(|l| l.starts_with("f "))
        .map(|l| [0, 1, 2].map(|k| points[numbers(l)[k] as usize - 1]))
        .collect();
    let (low, high) = points.iter().fold((points[0], points[0]), |(l, h), p| (l.inf(p), h.sup(p)));
    let axis = (high - low).imax();
    let edge = low[axis] + 0.65 * (high - low)[axis];
    let (mut vertices, mut faces, mut count) = (String::new(), String::new(), 0);
    while let Some(t) = open.pop() {
        let side = |i: usize| (t[i] - t[(i + 1) % 3]).norm();
        let longest = (0..3).max_by(|a, b| side(*a).total_cmp(&side(*b))).unwrap();
        let crosses = t.iter().any(|p| p[axis] < edge) && t.iter().any(|p| p[axis] > edge);
        if crosses && side(longest) > 0.01 {
            let [a, b, c] = [t[longest], t[(longest + 1) % 3], t[(longest + 2) % 3]];
            let middle = nalgebra::center(&a, &b);
            open.extend([[a, middle, c], [middle, b, c]]);
        } else if t.iter().all(|p| p[axis] <= edge) {
            t.iter().for_each(|p| vertices.push_str(&format!("v {} {} {}\n", p.x, p.y, p.z)));
            faces.push_str(&format!("f {} {} {}\n", count + 1, count + 2, count + 3));
            count += 3;
        }
    }
    fs::write(to, vertices + &faces).unwrap();
}
