//! Which file takes names from which.

use std::collections::BTreeSet;

use super::reader::{Source, paths, spelled_out};

/// All files of `src/` and what each imports from its own crate.
pub struct House {
    pub sources: Vec<Source>,
}

impl House {
    /// The files that a file takes names from. Re-exports are followed to the file that defines; a face's own
    /// re-exports are no imports.
    pub fn imports_of(&self, source: &Source) -> BTreeSet<&str> {
        let code = without_re_exports(&source.code);
        let here = module_of(&source.name);
        let mut to = BTreeSet::new();
        let root = &here[..usize::from(source.layer() != "cli").min(here.len())];
        for path in paths(&code, "crate") {
            to.extend(self.file_of(root, &segments(&path)[1..]));
        }
        for path in paths(&code, "super") {
            to.extend(self.file_of(&here[..here.len().saturating_sub(1)], &segments(&path)[1..]));
        }
        for child in self.children(&here) {
            let used = paths(&code, child).into_iter().filter(|p| p.contains("::"));
            to.extend(used.filter_map(|p| self.file_of(&here, &segments(&p))));
        }
        to.remove(source.name.as_str());
        to
    }

    fn children(&self, module: &[&str]) -> BTreeSet<&str> {
        let below = self.sources.iter().filter_map(|s| {
            let of = module_of(&s.name);
            (of.len() == module.len() + 1 && of.starts_with(module)).then(|| of[module.len()])
        });
        below.filter(|c| !["lib", "main"].contains(c)).collect()
    }

    /// The file that defines what a path names, seen from a module.
    fn file_of(&self, from: &[&str], path: &[&str]) -> Option<&str> {
        let mut module: Vec<&str> = from.to_vec();
        let mut path: Vec<&str> = path.to_vec();
        for _ in 0..16 {
            while let Some(&first) = path.first() {
                let below: Vec<&str> = module.iter().copied().chain([first]).collect();
                match (first, self.file(&below)) {
                    ("self", _) => {}
                    ("super", _) => _ = module.pop(),
                    (_, Some(_)) => module = below,
                    (_, None) => break,
                }
                path.remove(0);
            }
            let file = self.file(&module)?;
            let named = path.first().and_then(|name| re_exported(&file.code, name));
            match named {
                Some(target) => path = target,
                None => return Some(&file.name),
            }
        }
        None
    }

    fn file(&self, module: &[&str]) -> Option<&Source> {
        self.sources
            .iter()
            .find(|s| !["lib.rs", "main.rs"].contains(&s.name.as_str()) && module_of(&s.name) == module)
    }
}

/// The path by which a face hands a name on, relative to the face.
fn re_exported<'a>(code: &'a str, name: &str) -> Option<Vec<&'a str>> {
    let uses = code.split("pub use ").chain(code.split("pub(crate) use ")).skip(1);
    for tail in uses {
        let tree = tail.split_once(';').map_or(tail, |(tree, _)| tree).trim();
        let root: &str = &tree[..tree.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(tree.len())];
        let rest = tree[root.len()..].strip_prefix("::").unwrap_or_default();
        let hit = spelled_out(root, rest).into_iter().find(|p| p.rsplit("::").next() == Some(name));
        if let Some(hit) = hit.filter(|_| root != "crate") {
            let mut at = 0;
            // Every segment stands in the code; this borrows it from there.
            let borrowed = hit.split("::").filter_map(|segment| {
                let start = tree[at..].find(segment)?;
                let found = &tree[at + start..at + start + segment.len()];
                at = if at == 0 { start } else { at };
                Some(found)
            });
            return Some(borrowed.collect());
        }
    }
    None
}

fn without_re_exports(code: &str) -> String {
    let mut pieces = code.split("pub use ").flat_map(|p| p.split("pub(crate) use "));
    let mut kept = pieces.next().unwrap_or_default().to_owned();
    pieces.for_each(|piece| kept.push_str(piece.split_once(';').map_or("", |(_, rest)| rest)));
    kept
}

fn module_of(file: &str) -> Vec<&str> {
    let module = file.trim_end_matches(".rs");
    ["/mod", "/lib"].iter().find_map(|face| module.strip_suffix(face)).unwrap_or(module).split('/').collect()
}

fn segments(path: &str) -> Vec<&str> {
    path.split("::").collect()
}
