"""All mutants of one crate that cargo-mutants lists, written at once into a scratch copy of the workspace.

Each mutant stands behind `crate::mutant::is_active(N)`, so that one build serves them all: the
environment variable MUTANT=N, read once, turns mutant N on (Untch, Offutt and Harrold 1993: mutant
schemata). A mutant that the compiler refuses is left out and the check is repeated, until the copy compiles.

    cargo mutants --workspace --list --json -f src/surface/tsdf.rs ... > mutants.json
    python schemata.py mutants.json TREE SCRATCH --crate surface

writes SCRATCH (an empty folder, or one of an earlier run) and `SCRATCH/schemata.json`: the mutants with their
number and state, `built`, `unviable` or `unwritten` (no schema for it: to be tried by hand).
"""

import argparse
import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import tree_sitter_rust
from tree_sitter import Language, Node, Parser

# What the compiler refuses only after minutes, or never: values of nalgebra's types and of grids that
# cargo-mutants makes of nothing or of one number; and products where `DMatrix::zeros(..)` has no type of
# numbers yet, which it takes for matrices of matrices of matrices.
REFUSED = re.compile(
    r"\b(DMatrix|DVector|SMatrix|Matrix\d|Vector\d|Point3|Grid3)::(new|from|from_iter)\("
    r"|(with \*=?|replace \* with .) in (normal_equations|blocks|JointCovariance.*::new)"
)
COMPARISONS = {"==", "!=", "<", ">", "<=", ">="}
SWITCH = """\
//! Which mutant is active: number MUTANT of the environment, or none. With MUTANT_REACHED=FILE each mutant
//! that is reached is written to that file, once.
#![allow(missing_docs, clippy::all)]

use std::{
    io::Write,
    sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed},
};

const UNREAD: u32 = u32::MAX;
const TRACED: u32 = u32::MAX - 1;
static ACTIVE: AtomicU32 = AtomicU32::new(UNREAD);
static SEEN: [AtomicBool; COUNT] = [const { AtomicBool::new(false) }; COUNT];

#[inline]
pub fn is_active(number: u32) -> bool {
    let active = ACTIVE.load(Relaxed);
    if active >= TRACED { unusual(number, active) } else { active == number }
}

#[cold]
fn unusual(number: u32, active: u32) -> bool {
    if active == UNREAD {
        let wanted = std::env::var("MUTANT").ok().and_then(|n| n.parse().ok()).unwrap_or(0);
        let traced = std::env::var_os("MUTANT_REACHED").is_some();
        ACTIVE.store(if traced { TRACED } else { wanted }, Relaxed);
        return is_active(number);
    }
    if !SEEN[number as usize].swap(true, Relaxed) {
        let file = std::env::var_os("MUTANT_REACHED").unwrap();
        let mut file = std::fs::OpenOptions::new().create(true).append(true).open(file).unwrap();
        file.write_all(format!("{number}\\n").as_bytes()).unwrap();
    }
    false
}
"""


class Rewriter:
    """Writes one file with its mutants: the text of every node, those of its children inside."""

    def __init__(self, source: str, mutants: list[dict]):
        self.source = source.encode()
        self.line_starts = [0]
        for line in source.splitlines(keepends=True):
            self.line_starts.append(self.line_starts[-1] + len(line.encode()))
        self.lines = source.splitlines(keepends=True)
        self.at: dict[tuple[str, int], list[dict]] = {}
        for mutant in mutants:
            place = mutant["span"]["start"]
            key = (kind_of(mutant), self.offset(place["line"], place["column"]))
            self.at.setdefault(key, []).append(mutant)
        self.written: set[int] = set()

    def offset(self, line: int, column: int) -> int:
        """Byte offset of a place, which counts characters from 1."""
        return self.line_starts[line - 1] + len(self.lines[line - 1][: column - 1].encode())

    def here(self, kind: str, byte: int) -> list[dict]:
        found = self.at.get((kind, byte), [])
        self.written.update(m["number"] for m in found)
        return found

    def text(self, node: Node) -> str:
        """The node's text with the mutants that are inside it."""
        rewrite = getattr(self, node.type, None)
        return (rewrite(node) if rewrite else None) or self.plain(node)

    def plain(self, node: Node, instead: dict[int, str] | None = None) -> str:
        """The node's text, its children rewritten, or replaced by what `instead` has for their start."""
        parts, end = [], node.start_byte
        for child in node.children:
            parts.append(self.source[end : child.start_byte].decode())
            replaced = (instead or {}).get(child.start_byte)
            parts.append(self.text(child) if replaced is None else replaced)
            end = child.end_byte
        parts.append(self.source[end : node.end_byte].decode())
        return "".join(parts)

    def operation(self, node: Node) -> tuple[str, list[dict], str, str]:
        """An operator, its mutants, and the text of both sides, which is empty where there are no mutants."""
        operator = node.child_by_field_name("operator")
        mutants = self.here("operator", operator.start_byte)
        if not mutants:
            return operator.type, mutants, "", ""
        left, right = (self.text(node.child_by_field_name(side)) for side in ("left", "right"))
        return operator.type, mutants, left, right

    def binary_expression(self, node: Node) -> str | None:
        op, mutants, left, right = self.operation(node)
        if not mutants:
            return None
        if op in ("&&", "||"):
            # Lazy: the right side is evaluated where the left one, or its mutant, asks for it.
            [mutant] = mutants
            test = "!=" if op == "&&" else "=="
            active = marked(mutant, f"crate::mutant::is_active({mutant['number']})")
            return wrapped(
                mutants, f"{{ let m_l: bool = {left}; if m_l {test} {active} {{ {right} }} else {{ m_l }} }}"
            )
        reference, value = ("&", "*") if op in COMPARISONS else ("", "")
        arms = choice(mutants, lambda o: f"{value}m_l {o} {value}m_r", op)
        return wrapped(
            mutants, f"match ({reference}({left}), {reference}({right})) {{ (m_l, m_r) => {arms} }}"
        )

    def compound_assignment_expr(self, node: Node) -> str | None:
        op, mutants, left, right = self.operation(node)
        if not mutants:
            return None
        arms = choice(mutants, lambda o: f"{left} {o} m_r", op)
        return wrapped(mutants, f"match {right} {{ m_r => {arms} }}")

    def unary_expression(self, node: Node) -> str | None:
        operator = node.children[0]
        mutants = self.here("unary", operator.start_byte)
        if not mutants:
            return None
        operand = self.text(node.children[1])
        arms = choice(mutants, lambda o: f"{o}m_x", operator.type)
        return wrapped(mutants, f"match {operand} {{ m_x => {arms} }}")

    def function_item(self, node: Node) -> str | None:
        body = node.child_by_field_name("body")
        # The list names where the first statement begins.
        mutants = [m for child in body.children for m in self.here("body", child.start_byte)]
        if not mutants:
            return None
        returns = node.child_by_field_name("return_type")
        is_iterator = returns is not None and self.source[returns.start_byte :].startswith(b"impl Iterator")
        inner = self.plain(body)
        if is_iterator:
            # One type for all: an `impl Iterator` cannot be returned as another.
            made = [(m, f"Box::new({m['replacement']}) as Box<dyn Iterator<Item = _>>") for m in mutants]
            inner = f"{{ Box::new({inner}) as Box<dyn Iterator<Item = _>> }}"
        else:
            made = [(m, m["replacement"]) for m in mutants]
        tests = [
            f"if crate::mutant::is_active({m['number']}) {{ return {marked(m, t)}; }}\n" for m, t in made
        ]
        return self.plain(node, {body.start_byte: "{ " + "".join(tests) + inner[1:]})

    def match_arm(self, node: Node) -> str | None:
        pattern = node.child_by_field_name("pattern")
        deleted = self.here("arm", node.start_byte)
        condition = pattern.child_by_field_name("condition")
        guards = self.here("guard", condition.start_byte) if condition else []
        if not deleted and not guards:
            return None
        guard = self.text(condition) if condition else "true"
        for mutant in guards:
            active = f"crate::mutant::is_active({mutant['number']})"
            guard = f"(if {active} {{ {marked(mutant, mutant['replacement'])} }} else {{ {guard} }})"
        for mutant in deleted:
            guard = marked(mutant, f"!crate::mutant::is_active({mutant['number']})") + f" && ({guard})"
        shape = self.text(pattern.children[0])
        for child in pattern.children[1:]:
            if child.type == "if":
                break
            shape += " " + self.text(child)
        return self.plain(node, {pattern.start_byte: f"{shape} if {wrapped(deleted + guards, guard)}"})

    def struct_expression(self, node: Node) -> str | None:
        fields = node.child_by_field_name("body")
        bases = [f for f in fields.named_children if f.type == "base_field_initializer"]
        instead = {}
        for field in fields.named_children:
            mutants = self.here("field", field.start_byte) if bases else []
            for mutant in mutants:
                name = self.source[field.start_byte : field.end_byte].decode().split(":")[0].strip()
                value = field.child_by_field_name("value")
                value = self.text(value) if value else name
                base = self.plain(bases[0])[2:]
                active = f"crate::mutant::is_active({mutant['number']})"
                kept = f"if {active} {{ {marked(mutant, f'({base}).{name}')} }} else {{ {value} }}"
                instead[field.start_byte] = f"{name}: {wrapped(mutants, kept)}"
        return self.plain(node, {fields.start_byte: self.plain(fields, instead)}) if instead else None


def kind_of(mutant: dict) -> str:
    """What is replaced."""
    kinds = {
        "FnValue": "body",
        "BinaryOperator": "operator",
        "UnaryOperator": "unary",
        "MatchArm": "arm",
        "MatchArmGuard": "guard",
        "StructField": "field",
    }
    return kinds.get(mutant["genre"], mutant["genre"])


def marked(mutant: dict, text: str) -> str:
    """Text between marks, by which an error of the compiler leads to the mutant."""
    return f"/*<{mutant['number']}*/{text}/*{mutant['number']}>*/"


def wrapped(mutants: list[dict], text: str) -> str:
    """A schema of some mutants between marks."""
    numbers = "+".join(str(m["number"]) for m in mutants)
    return f"(/*[{numbers}*/{text}/*{numbers}]*/)"


def choice(mutants: list[dict], text, original: str) -> str:
    """What stands there, whose type the compiler then expects, else what each mutant makes of an operator."""
    tests = [f"crate::mutant::is_active({m['number']})" for m in mutants]
    changed = [marked(m, text(m["replacement"])) for m in mutants]
    others = " else ".join(f"if {test} {{ {made} }}" for test, made in zip(tests[:-1], changed))
    others += f" else {{ {changed[-1]} }}" if others else f"{{ {changed[-1]} }}"
    return f"{{ if !({' | '.join(tests)}) {{ {text(original)} }} else {others} }}"


def write(mutants: list[dict], tree: Path, scratch: Path, crate: str) -> None:
    """Writes the files with the mutants whose state is `built`; those without a schema become `unwritten`."""
    parser = Parser(Language(tree_sitter_rust.language()))
    for name in sorted({m["file"] for m in mutants}):
        source = (tree / name).read_text()
        here = [m for m in mutants if m["file"] == name and m["state"] == "built"]
        rewriter = Rewriter(source, here)
        text = rewriter.text(parser.parse(source.encode()).root_node)
        (scratch / name).write_text(text)
        for mutant in here:
            if mutant["number"] not in rewriter.written:
                mutant["state"] = "unwritten"
    root = f"src/{crate}"
    lib = (tree / root / "lib.rs").read_text()
    (scratch / root / "lib.rs").write_text(lib + "\n#[doc(hidden)]\npub mod mutant;\n")
    (scratch / root / "mutant.rs").write_text(SWITCH.replace("COUNT", str(len(mutants) + 1)))


def refused(scratch: Path, mutants: dict[int, dict], check: list[str]) -> dict[int, str]:
    """The mutants that the compiler refuses, and those whose schema it does, with the state that follows."""
    done = subprocess.run(check, cwd=scratch, capture_output=True, text=True, env=os.environ)
    found: dict[int, str] = {}
    strange = []
    for line in done.stdout.splitlines():
        message = json.loads(line).get("message") or {}
        if message.get("level") != "error" or not message.get("spans"):
            continue
        spans = sorted(message["spans"], key=lambda s: not s["is_primary"])
        states = next((s for span in spans if (s := blamed(scratch, span, message["message"]))), [])
        for number, state in states:
            found[number] = state
            mutants[number]["error"] = message["message"]
        if not states:
            strange.append(message["rendered"])
    if done.returncode and not found:
        raise SystemExit("".join(strange) + done.stderr[-3000:])
    return found


def blamed(scratch: Path, span: dict, message: str) -> list[tuple[int, str]]:
    """The mutant at a place of an error, with its state; none where there is no mutant."""
    path = scratch / span["file_name"]
    if not path.is_file() or scratch not in path.resolve().parents:
        return []
    opened = []
    for mark in re.finditer(rb"/\*([<\[])?([0-9+]+)[>\]]?\*/", path.read_bytes()[: span["byte_start"] + 1]):
        if mark[1]:
            opened.append((mark[1], mark[2].decode()))
        else:
            opened.pop()
    if not opened:
        return []
    # Where the whole schema is blamed, the last of its mutants goes; the others are tried without it.
    *others, last = opened[-1][1].split("+")
    is_mutant = opened[-1][0] == b"<" or others or "incompatible types" in message
    return [(int(last), "unviable" if is_mutant else "unwritten")]


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    arguments.add_argument("mutants", type=Path, help="what cargo mutants --list --json says")
    arguments.add_argument("tree", type=Path, help="the tree that it was said of")
    arguments.add_argument("scratch", type=Path, help="folder for the copy")
    arguments.add_argument("--crate", required=True, help="folder of the crate below src")
    arguments.add_argument("--check", help="default: builds the crate's unit tests")
    options = arguments.parse_args()
    scratch = options.scratch.resolve()
    scratch.mkdir(parents=True, exist_ok=True)
    for name in subprocess.check_output(["git", "ls-files"], cwd=options.tree, text=True).splitlines():
        source, target = options.tree / name, scratch / name
        if not target.is_file() or source.stat().st_mtime > target.stat().st_mtime:
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target)
    mutants = json.loads(options.mutants.read_text())
    mutants = [m for m in mutants if m["file"].startswith(f"src/{options.crate}/")]
    earlier = scratch / "schemata.json"
    known = {m["name"]: m["state"] for m in json.loads(earlier.read_text())} if earlier.exists() else {}
    for number, mutant in enumerate(mutants, 1):
        state = "unviable" if REFUSED.search(mutant["name"]) else known.get(mutant["name"], "built")
        mutant.update(number=number, state=state)
        mutant.pop("diff", None)
    by_number = {m["number"]: m for m in mutants}
    check = options.check or f"cargo test --release --lib --no-run -p artitwin-{options.crate}"
    check = [*check.split(), "--message-format=json"]
    while True:
        write(mutants, options.tree, scratch, options.crate)
        (scratch / "schemata.json").write_text(json.dumps(mutants, indent=1))
        found = refused(scratch, by_number, check)
        print(
            len([m for m in mutants if m["state"] == "built"]), "written,", len(found), "refused", flush=True
        )
        if not found:
            break
        for number, state in found.items():
            by_number[number]["state"] = state


if __name__ == "__main__":
    main()
