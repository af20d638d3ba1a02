//! Links held together by fixed joints: simulators move them as one body.

use super::{description::Description, places::first_places};

/// The bodies of welded links, and whether they move.
pub(super) struct Welds {
    /// For every link, the representative link of its body.
    body: Vec<usize>,
    /// For every link, whether a joint moves its body.
    moves: Vec<bool>,
}

impl Welds {
    pub(super) fn of_description(description: &Description) -> Self {
        let links = first_places(description.links.iter().map(|l| l.name.as_str()));
        let mut toward: Vec<usize> = (0..description.links.len()).collect();
        let place = |name: &String| links.get(name.as_str()).copied();
        for joint in description.joints.iter().filter(|j| j.kind == "fixed") {
            if let (Some(parent), Some(child)) = (place(&joint.parent), place(&joint.child)) {
                let parent = representative_link(&mut toward, parent);
                let child = representative_link(&mut toward, child);
                toward[child] = parent;
            }
        }
        let body: Vec<usize> = (0..toward.len()).map(|link| representative_link(&mut toward, link)).collect();
        let mut moves = vec![false; body.len()];
        for joint in description.joints.iter().filter(|j| j.kind != "fixed") {
            place(&joint.child).into_iter().for_each(|child| moves[body[child]] = true);
        }
        Self { moves: body.iter().map(|b| moves[*b]).collect(), body }
    }

    /// Whether a joint moves the body of a link; otherwise it is fixed to the world.
    pub(super) fn is_moving(&self, link: usize) -> bool {
        self.moves[link]
    }

    /// Whether two links are one body.
    pub(super) fn is_one(&self, a: usize, b: usize) -> bool {
        self.body[a] == self.body[b]
    }

    /// For every link, whether `test` is true for a link of its body.
    pub(super) fn bodies_with(&self, test: impl Fn(usize) -> bool) -> Vec<bool> {
        let mut some = vec![false; self.body.len()];
        (0..self.body.len()).filter(|l| test(*l)).for_each(|link| some[self.body[link]] = true);
        self.body.iter().map(|b| some[*b]).collect()
    }
}

/// The representative of a link's body; shortens the path to it for later calls.
fn representative_link(toward: &mut [usize], mut link: usize) -> usize {
    while toward[link] != link {
        toward[link] = toward[toward[link]];
        link = toward[link];
    }
    link
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fixed_joints_make_bodies_and_others_move_them() {
        let joint = |name: &str, kind: &str, parent: &str, child: &str| {
            format!(
                "<joint name='{name}' type='{kind}'><parent link='{parent}'/><child link='{child}'/></joint>"
            )
        };
        let links: String = ["a", "b", "c", "d", "e"].map(|n| format!("<link name='{n}'/>")).concat();
        // b hangs on a, d on c which turns on b; e is apart; the joint to nowhere holds nothing.
        let joints = [
            joint("1", "fixed", "a", "b"),
            joint("2", "revolute", "b", "c"),
            joint("3", "fixed", "c", "d"),
            joint("4", "fixed", "e", "nowhere"),
        ]
        .concat();
        let welds =
            Welds::of_description(&Description::parse(&format!("<robot>{links}{joints}</robot>")).unwrap());
        assert_eq!([0, 1, 2, 3, 4].map(|l| welds.is_moving(l)), [false, false, true, true, false]);
        assert!(welds.is_one(0, 1) && welds.is_one(2, 3) && !welds.is_one(1, 2) && !welds.is_one(0, 4));
        assert_eq!(welds.bodies_with(|l| l == 3), [false, false, true, true, false]);
        // A ring ends, too.
        let ring = [joint("1", "fixed", "a", "b"), joint("2", "fixed", "b", "a")].concat();
        let welds =
            Welds::of_description(&Description::parse(&format!("<robot>{links}{ring}</robot>")).unwrap());
        assert!(welds.is_one(0, 1));
    }
}
