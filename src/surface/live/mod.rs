//! The map of a state while it is collected: view by view, in bounded memory, on the calling thread. It holds
//! the seen surface as a mesh, the unseen surface, the next view, and the surface that moved since the state
//! before.
//!
//! ```text
//! frame -> view_depth -> clearance -> sight_map (seen empty, seen filled) -> region -> unseen, next_view
//!          view_depth -> block_map (distances, colors) -> live_mesh -> moved
//! ```

mod block_map;
mod clearance;
mod eyes;
mod live_mesh;
mod map;
mod moved;
mod next_view;
mod region;
mod sight_map;
#[cfg(test)]
mod tests;
mod unseen;
mod view_depth;

pub use live_mesh::MeshChunk;
pub use map::{LiveMap, LiveSettings};
pub use moved::Moved;
pub use next_view::NextView;
pub use unseen::{Unseen, UnseenPatch};
