//! The border of an open mesh as closed loops of vertices.

use crate::{TriangleMesh, edges::sides_by_vertex};

/// The border as closed loops, each with the surface on its left seen from outside; no loop passes a vertex
/// twice. `None` where two triangles have the same side in the same direction: such a mesh has no clear
/// border. Loops are in the order in which the walk, begun at the lowest vertex, closes them.
pub(super) fn border_loops(mesh: &TriangleMesh) -> Option<Vec<Vec<u32>>> {
    let sides = sides_by_vertex(mesh);
    if sides.all().any(|(_, ends)| ends.windows(2).any(|w| w[0] == w[1])) {
        return None;
    }
    let all = sides.all().flat_map(|(p, ends)| ends.iter().map(move |q| (p, *q)));
    let open: Vec<(u32, u32)> = all.filter(|&(p, q)| !sides.list_at(q).contains(&p)).collect();
    // As many open sides begin at a vertex as end there: every triangle contributes one of each, and every
    // removed pair takes one of each away. So every walk along unused sides returns to its start.
    let mut used = vec![false; open.len()];
    let mut place = vec![usize::MAX; mesh.vertices.len()];
    let mut loops = Vec::new();
    for start in 0..open.len() {
        if used[start] {
            continue;
        }
        let mut path = vec![open[start].0];
        place[open[start].0 as usize] = 0;
        while let Some(&end) = path.last() {
            let first = open.partition_point(|s| s.0 < end);
            let next = (first..open.len()).take_while(|&i| open[i].0 == end).find(|&i| !used[i]);
            let Some(next) = next else { break };
            used[next] = true;
            let to = open[next].1;
            let back = place[to as usize];
            if back == usize::MAX {
                place[to as usize] = path.len();
                path.push(to);
            } else {
                // Back at a vertex of the path: the vertices since then are a loop of their own.
                let closed = path.split_off(back);
                closed.iter().for_each(|&v| place[v as usize] = usize::MAX);
                loops.push(closed);
                path.push(to);
                place[to as usize] = back;
            }
        }
        path.iter().for_each(|&v| place[v as usize] = usize::MAX);
    }
    Some(loops)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{borders::plates::plate, shapes::box_mesh};
    use nalgebra::Vector3;

    #[test]
    fn a_closed_mesh_has_no_border_and_a_doubled_triangle_no_clear_one() {
        let mut mesh = box_mesh(Vector3::repeat(0.1));
        assert_eq!(border_loops(&mesh), Some(Vec::new()));
        mesh.triangles.push(mesh.triangles[0]);
        assert_eq!(border_loops(&mesh), None);
    }

    #[test]
    fn holes_that_touch_are_loops_of_their_own() {
        // Two missing cells with one corner in common, and the outer border.
        let mesh = plate(6, 6, |x, y| (x, y) != (2, 2) && (x, y) != (3, 3));
        let mut sizes: Vec<usize> = border_loops(&mesh).unwrap().iter().map(Vec::len).collect();
        sizes.sort_unstable();
        assert_eq!(sizes, [4, 4, 24]);
    }

    #[test]
    fn the_surface_lies_on_the_left() {
        let mesh = plate(5, 5, |x, y| (x, y) != (2, 2));
        let area = |l: &Vec<u32>| {
            let p = |k: usize| mesh.vertices[l[k % l.len()] as usize].coords;
            (0..l.len()).map(|k| p(k).cross(&p(k + 1)).z).sum::<f32>() * 0.5
        };
        let areas: Vec<f32> = border_loops(&mesh).unwrap().iter().map(area).collect();
        assert_eq!(areas.len(), 2);
        assert!(
            areas.iter().any(|a| (a - 25.0).abs() < 1e-4) && areas.iter().any(|a| (a + 1.0).abs() < 1e-4)
        );
    }
}
