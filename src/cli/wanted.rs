//! What an option wants, where its value is something else.

/// Why the value of an option cannot be used: what to give.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("give {0}")]
pub(super) struct Wanted(pub &'static str);

/// Reads three numbers.
pub(super) fn vector(text: &str) -> Result<[f64; 3], Wanted> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|n| n.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[x, y, z]) if [x, y, z].iter().all(|v| v.is_finite()) => Ok([x, y, z]),
        _ => Err(Wanted("three numbers x,y,z")),
    }
}
