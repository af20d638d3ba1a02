//! The small part of Python's pickle in which NumPy stores arrays of objects. Nothing is ever executed: only
//! plain containers, numbers, strings and NumPy arrays are understood; everything else is refused.

use std::collections::BTreeMap;

use common::limits::{PICKLE_NAME, PICKLE_VALUES};

/// Most axes of an array, and most parts of the state of an array or type.
const MAX_PARTS: usize = 16;

/// Why a pickle is not read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PickleError {
    /// It ends early.
    #[error("the pickle is cut")]
    Cut,
    /// The name of a type or function is too long.
    #[error("a name of {0} characters; {PICKLE_NAME} are the limit")]
    Name(usize),
    /// It mentions more values than the limit.
    #[error("the pickle mentions more than {PICKLE_VALUES} values")]
    Large,
    /// An unknown or unsafe instruction.
    #[error("pickle instruction 0x{0:02x} is not taken")]
    Instruction(u8),
    /// A function outside NumPy's constructors.
    #[error("the pickle calls `{0}`, which is not taken")]
    Call(String),
    /// Instructions in an invalid order.
    #[error("{0}")]
    Broken(&'static str),
    /// A count beyond this machine's memory.
    #[error(transparent)]
    Count(#[from] std::num::TryFromIntError),
}

const EMPTY: PickleError = PickleError::Broken("the stack is empty");

/// Index of a value.
pub type Id = usize;

/// A value.
#[derive(Clone, Debug, PartialEq)]
pub enum Node {
    /// None, and objects that are not needed.
    None,
    /// A truth value or whole number.
    Int(i64),
    /// A number.
    Float(f64),
    /// Text.
    Str(String),
    /// Bytes.
    Bytes(Vec<u8>),
    /// List.
    List(Vec<Id>),
    /// Tuple.
    Tuple(Vec<Id>),
    /// Dictionary, in its order.
    Dict(Vec<(Id, Id)>),
    /// A name in a module.
    Global(String),
    /// NumPy type, e.g. `<i8`.
    Dtype(String),
    /// NumPy array: shape, type, and its bytes or objects.
    Array {
        /// Lengths of its axes.
        shape: Vec<usize>,
        /// Type, e.g. `<i8`.
        dtype: String,
        /// Index of its bytes or list.
        data: Id,
        /// Whether it is column-major.
        fortran: bool,
    },
    Mark,
}

/// All values of a file.
#[derive(Debug)]
pub struct Pickle {
    /// Values by index.
    pub nodes: Vec<Node>,
    /// Index of the outermost value.
    pub root: Id,
}

impl Pickle {
    /// Reads a pickle (protocols 2 to 5).
    ///
    /// # Errors
    /// The first part that is not supported.
    pub fn read(data: &[u8]) -> Result<Self, PickleError> {
        let mut machine =
            Machine { data, at: 0, nodes: Vec::new(), stack: Vec::new(), memo: BTreeMap::new(), mentions: 0 };
        let root = machine.run()?;
        Ok(Self { nodes: machine.nodes, root })
    }

    /// The values of a list, tuple or array of objects.
    #[must_use]
    pub fn items(&self, id: Id) -> Option<&[Id]> {
        match &self.nodes[id] {
            Node::List(items) | Node::Tuple(items) => Some(items),
            Node::Array { data, .. } => match &self.nodes[*data] {
                Node::List(items) => Some(items),
                _ => None,
            },
            _ => None,
        }
    }

    /// An array of N x 2 numbers.
    #[must_use]
    pub fn pairs(&self, id: Id) -> Option<Vec<[f64; 2]>> {
        let Node::Array { shape, dtype, data, fortran } = &self.nodes[id] else { return None };
        let ([count, 2], Node::Bytes(bytes)) = (shape.as_slice(), &self.nodes[*data]) else { return None };
        let size: usize = dtype.get(2..)?.parse().ok().filter(|s| [1, 2, 4, 8].contains(s))?;
        if bytes.len() != count.checked_mul(2)?.checked_mul(size)? || dtype.starts_with('>') {
            return None;
        }
        let kind = dtype.as_bytes()[1];
        let numbers: Option<Vec<f64>> = bytes.chunks_exact(size).map(|b| number(kind, b)).collect();
        let numbers = numbers?;
        let [row_step, column_step] = if *fortran { [1, *count] } else { [2, 1] };
        Some((0..*count).map(|row| [0, 1].map(|c| numbers[row * row_step + c * column_step])).collect())
    }
}

fn number(kind: u8, bytes: &[u8]) -> Option<f64> {
    let mut wide = [0u8; 8];
    wide[..bytes.len()].copy_from_slice(bytes);
    let unsigned = u64::from_le_bytes(wide);
    let spare = 64 - 8 * bytes.len() as u32;
    match (kind, bytes.len()) {
        (b'i', _) => Some(((unsigned << spare) as i64 >> spare) as f64),
        (b'u', _) => Some(unsigned as f64),
        (b'f', 4) => Some(f64::from(f32::from_bits(unsigned as u32))),
        (b'f', 8) => Some(f64::from_bits(unsigned)),
        _ => None,
    }
}

/// A name or type of limited length, as it is copied wherever it is used.
fn short(text: &str) -> Result<&str, PickleError> {
    if text.len() > PICKLE_NAME { Err(PickleError::Name(text.len())) } else { Ok(text) }
}

struct Machine<'a> {
    data: &'a [u8],
    at: usize,
    nodes: Vec<Node>,
    stack: Vec<Id>,
    // A map, because a key may be any number and would let the file decide the size of a vector.
    memo: BTreeMap<usize, Id>,
    /// Values put on the stack.
    mentions: usize,
}

impl Machine<'_> {
    fn run(&mut self) -> Result<Id, PickleError> {
        loop {
            // Counts mentions, not values: through the memo a short file can mention one array a million
            // times.
            if self.mentions > PICKLE_VALUES {
                return Err(PickleError::Large);
            }
            let op = self.take(1)?[0];
            // Names in Python's pickletools: `.` STOP, 0x80 PROTO, 0x95 FRAME, `q` BINPUT, `r`
            // LONG_BINPUT, 0x94 MEMOIZE, `h` BINGET, `j` LONG_BINGET, `(` MARK, `0` POP. An unknown
            // instruction ends the reading: nothing says how long it is.
            match op {
                b'.' => return self.pop(),
                0x80 => _ = self.take(1)?,
                0x95 => _ = self.take(8)?,
                b'q' | b'r' | 0x94 => self.remember(op)?,
                b'h' => {
                    let key = usize::from(self.take(1)?[0]);
                    self.recall(key)?;
                }
                b'j' => {
                    let key = self.u32()?;
                    self.recall(key)?;
                }
                b'(' => self.push(Node::Mark),
                b'a' | b'e' | b's' | b'u' | b'R' | b'b' | b't' | 0x85..=0x87 | 0x93 => self.combine(op)?,
                b'0' => _ = self.pop()?,
                _ => {
                    let node = self.literal(op)?;
                    self.push(node);
                }
            }
        }
    }

    fn literal(&mut self, op: u8) -> Result<Node, PickleError> {
        // `N` NONE, 0x88 NEWTRUE, 0x89 NEWFALSE, `K` BININT1, `M` BININT2, `J` BININT, 0x8a LONG1,
        // `G` BINFLOAT, `X` and 0x8c, 0x8d BINUNICODE of three widths, `B`, `C`, 0x8e BINBYTES,
        // `]` `)` `}` empty containers, `c` GLOBAL.
        Ok(match op {
            b'N' => Node::None,
            0x88 => Node::Int(1),
            0x89 => Node::Int(0),
            b'K' => Node::Int(i64::from(self.take(1)?[0])),
            b'M' => Node::Int(self.little(2)? as i64),
            b'J' => Node::Int(i64::from(self.little(4)? as u32 as i32)),
            0x8a => {
                let n = usize::from(self.take(1)?[0]);
                if n > 8 {
                    return Err(PickleError::Broken("a number has more than 64 bits"));
                }
                let value = self.little(n)?;
                // No bytes stand for 0; the shift has to stay below 64.
                let spare = 64 - 8 * n.max(1) as u32;
                Node::Int((value << spare) as i64 >> spare)
            }
            // The one big-endian number of the format.
            b'G' => Node::Float(f64::from_bits(self.little(8)?.swap_bytes())),
            b'X' | 0x8c | 0x8d => Node::Str(String::from_utf8_lossy(self.counted(op)?).into_owned()),
            b'B' | b'C' | 0x8e => Node::Bytes(self.counted(op)?.to_vec()),
            b']' => Node::List(Vec::new()),
            b')' => Node::Tuple(Vec::new()),
            b'}' => Node::Dict(Vec::new()),
            b'c' => {
                let module = self.line()?;
                let name = self.line()?;
                Node::Global(format!("{module}.{name}"))
            }
            other => return Err(PickleError::Instruction(other)),
        })
    }

    /// Instructions taking values off the stack.
    fn combine(&mut self, op: u8) -> Result<(), PickleError> {
        // `a` APPEND, `e` APPENDS, `s` SETITEM, `u` SETITEMS, `t` TUPLE, 0x85 to 0x87 TUPLE1 to 3,
        // 0x93 STACK_GLOBAL, `R` REDUCE, `b` BUILD.
        match op {
            b'a' | b'e' => {
                let items = if op == b'a' { vec![self.pop()?] } else { self.pop_to_mark()? };
                match self.top()? {
                    Node::List(list) => list.extend(items),
                    _ => return Err(PickleError::Broken("append to what is no list")),
                }
            }
            b's' | b'u' => {
                let items = if op == b's' { self.pop_many(2)? } else { self.pop_to_mark()? };
                match self.top()? {
                    Node::Dict(dict) => dict.extend(items.chunks_exact(2).map(|p| (p[0], p[1]))),
                    _ => return Err(PickleError::Broken("set an item of what is no dictionary")),
                }
            }
            b't' => {
                let items = self.pop_to_mark()?;
                self.push(Node::Tuple(items));
            }
            0x85..=0x87 => {
                let items = self.pop_many(usize::from(op - 0x84))?;
                self.push(Node::Tuple(items));
            }
            0x93 => {
                let parts = self.pop_many(2)?;
                let (Node::Str(module), Node::Str(name)) = (&self.nodes[parts[0]], &self.nodes[parts[1]])
                else {
                    return Err(PickleError::Broken("a global without a name"));
                };
                let name = format!("{}.{}", short(module)?, short(name)?);
                self.push(Node::Global(name));
            }
            b'R' => self.reduce()?,
            _ => self.build()?,
        }
        Ok(())
    }

    /// A call: only NumPy's constructors of arrays and types are known.
    fn reduce(&mut self) -> Result<(), PickleError> {
        let parts = self.pop_many(2)?;
        let Node::Global(name) = &self.nodes[parts[0]] else {
            return Err(PickleError::Broken("a call of what is no function"));
        };
        let node = match name.as_str() {
            // NumPy 2 renamed `core`. Shape, type and values come with BUILD.
            "numpy.core.multiarray._reconstruct" | "numpy._core.multiarray._reconstruct" => {
                self.push(Node::None);
                let data = self.pop()?;
                Node::Array { shape: Vec::new(), dtype: String::new(), data, fortran: false }
            }
            "numpy.dtype" => {
                let code = self.tuple(parts[1]).and_then(|t| t.first().copied()).map(|id| &self.nodes[id]);
                let Some(Node::Str(code)) = code else {
                    return Err(PickleError::Broken("a NumPy type without a code"));
                };
                // The byte order comes with BUILD, too.
                Node::Dtype(format!("|{}", short(code)?))
            }
            other => return Err(PickleError::Call(other.escape_debug().to_string())),
        };
        self.push(node);
        Ok(())
    }

    /// The state of an array or a type.
    fn build(&mut self) -> Result<(), PickleError> {
        let state = self.pop()?;
        let id = *self.stack.last().ok_or(EMPTY)?;
        let state = self
            .tuple(state)
            .filter(|s| s.len() <= MAX_PARTS)
            .ok_or(PickleError::Broken("a state that is no short tuple"))?
            .to_vec();
        let node = match &self.nodes[id] {
            // (version, byte order, ...)
            Node::Dtype(code) => match state.get(1).map(|s| &self.nodes[*s]) {
                Some(Node::Str(order)) => {
                    Node::Dtype(format!("{}{}", short(order)?, code.get(1..).unwrap_or_default()))
                }
                _ => return Err(PickleError::Broken("a NumPy type without byte order")),
            },
            Node::Array { .. } => {
                // (version, shape, type, whether column-major, values)
                let [_, shape, dtype, fortran, data] = state[..] else {
                    return Err(PickleError::Broken("an array with an unknown state"));
                };
                let shape: Option<Vec<usize>> = self
                    .tuple(shape)
                    .filter(|t| t.len() <= MAX_PARTS)
                    .map(|t| t.iter().filter_map(|i| self.length(*i)).collect());
                let Node::Dtype(dtype) = self.nodes[dtype].clone() else {
                    return Err(PickleError::Broken("an array without type"));
                };
                Node::Array {
                    shape: shape.ok_or(PickleError::Broken("an array without shape"))?,
                    dtype,
                    data,
                    fortran: self.nodes[fortran] == Node::Int(1),
                }
            }
            _ => return Err(PickleError::Broken("a state for what is neither array nor type")),
        };
        self.nodes[id] = node;
        Ok(())
    }

    fn tuple(&self, id: Id) -> Option<&[Id]> {
        if let Node::Tuple(items) = &self.nodes[id] { Some(items) } else { None }
    }

    fn length(&self, id: Id) -> Option<usize> {
        if let Node::Int(n) = self.nodes[id] { usize::try_from(n).ok() } else { None }
    }

    fn push(&mut self, node: Node) {
        self.mentions += 1;
        self.nodes.push(node);
        self.stack.push(self.nodes.len() - 1);
    }

    fn pop(&mut self) -> Result<Id, PickleError> {
        self.stack.pop().ok_or(EMPTY)
    }

    fn pop_many(&mut self, count: usize) -> Result<Vec<Id>, PickleError> {
        let at = self.stack.len().checked_sub(count).ok_or(EMPTY)?;
        Ok(self.stack.split_off(at))
    }

    fn pop_to_mark(&mut self) -> Result<Vec<Id>, PickleError> {
        let at = self
            .stack
            .iter()
            .rposition(|id| self.nodes[*id] == Node::Mark)
            .ok_or(PickleError::Broken("no mark"))?;
        let items = self.stack.split_off(at + 1);
        self.stack.pop();
        Ok(items)
    }

    fn top(&mut self) -> Result<&mut Node, PickleError> {
        let id = *self.stack.last().ok_or(EMPTY)?;
        Ok(&mut self.nodes[id])
    }

    fn remember(&mut self, op: u8) -> Result<(), PickleError> {
        let key = match op {
            b'q' => usize::from(self.take(1)?[0]),
            b'r' => self.u32()?,
            // MEMOIZE takes the next free number.
            _ => self.memo.len(),
        };
        if let Some(top) = self.stack.last() {
            self.memo.insert(key, *top);
        }
        Ok(())
    }

    fn recall(&mut self, key: usize) -> Result<(), PickleError> {
        let id = self.memo.get(&key).copied().ok_or(PickleError::Broken("an unknown memo"))?;
        self.mentions += 1;
        self.stack.push(id);
        Ok(())
    }

    fn take(&mut self, count: usize) -> Result<&[u8], PickleError> {
        let end = self.at.checked_add(count).ok_or(PickleError::Cut)?;
        let bytes = self.data.get(self.at..end).ok_or(PickleError::Cut)?;
        self.at = end;
        Ok(bytes)
    }

    fn little(&mut self, count: usize) -> Result<u64, PickleError> {
        Ok(self.take(count)?.iter().rev().fold(0, |n, b| n << 8 | u64::from(*b)))
    }

    fn u32(&mut self) -> Result<usize, PickleError> {
        Ok(usize::try_from(self.little(4)?)?)
    }

    fn counted(&mut self, op: u8) -> Result<&[u8], PickleError> {
        let width = match op {
            0x8c | b'C' => 1,
            0x8d | 0x8e => 8,
            _ => 4,
        };
        let count = usize::try_from(self.little(width)?)?;
        self.take(count)
    }

    fn line(&mut self) -> Result<String, PickleError> {
        let rest = &self.data[self.at..];
        let end = rest.iter().position(|b| *b == b'\n').ok_or(PickleError::Cut)?;
        self.at += end + 1;
        Ok(String::from_utf8_lossy(&rest[..end]).into_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(of: &[u8]) -> Vec<u8> {
        [b"X", &(of.len() as u32).to_le_bytes()[..], of].concat()
    }

    #[test]
    fn long_types_are_refused_before_they_are_copied() {
        let long = text(&vec![b'f'; 20 << 20]);
        let dtype = [b"\x80\x03cnumpy\ndtype\n", &long[..], b"\x85R."].concat();
        assert!(
            Pickle::read(&dtype)
                .unwrap_err()
                .to_string()
                .contains("a name of 20971520 characters; 256 are the limit")
        );
        let order = [
            b"\x80\x03cnumpy\ndtype\n",
            &text(b"i8")[..],
            b"\x85R(K\x03",
            &long,
            b"NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\0tb.",
        ]
        .concat();
        assert!(Pickle::read(&order).unwrap_err().to_string().contains("a name of"));
        let global = [b"\x80\x04", &long[..], &text(b"x"), b"\x93."].concat();
        assert!(Pickle::read(&global).unwrap_err().to_string().contains("a name of"));
    }

    #[test]
    fn values_and_mentions_are_counted() {
        let nones = [b"\x80\x03(", &vec![b'N'; 3_000_000][..], b"t."].concat();
        assert!(Pickle::read(&nones).unwrap_err().to_string().contains("more than 2000000 values"));
        let mentions = [b"\x80\x03]q\0(", &b"h\0".repeat(3_000_000)[..], b"e."].concat();
        assert!(Pickle::read(&mentions).unwrap_err().to_string().contains("more than 2000000 values"));
        let deep = [b"\x80\x03", &b"]".repeat(100_000)[..], &b"a".repeat(99_999), b"."].concat();
        assert_eq!(Pickle::read(&deep).unwrap().items(0).unwrap(), [1]);
    }
}
