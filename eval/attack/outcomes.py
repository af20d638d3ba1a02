"""What was tried and how it ended, as a table."""
import collections
from dataclasses import dataclass, field


@dataclass
class Family:
    """One kind of attack; `bad` are the sentences about what should not have happened."""

    name: str
    tried: int = 0
    codes: collections.Counter = field(default_factory=collections.Counter)
    memory_mb: float = 0.0
    seconds: float = 0.0
    bad: list = field(default_factory=list)

    def add(self, ended, wrong="", about=""):
        self.tried += 1
        self.codes["hung" if ended.code is None else ended.code] += 1
        self.memory_mb = max(self.memory_mb, ended.memory_mb)
        self.seconds = max(self.seconds, ended.seconds)
        wrong = ended.accident() or wrong
        if wrong:
            said = (ended.err.strip() or ended.out.strip())[-160:].replace("\n", " / ")
            self.complain(f"{about}: {wrong}: `{said}`")

    def check(self, holds, sentence):
        """A demand without a process of its own."""
        self.tried += 1
        self.codes["held" if holds else "broken"] += 1
        if not holds:
            self.complain(sentence)

    def complain(self, sentence):
        self.bad.append(sentence)
        print(f"BAD {self.name}: {sentence}", flush=True)


def markdown(families, heading):
    lines = [heading, "", "| attack | tried | outcomes | largest memory | longest | bad |", "|---|---|---|---|---|---|"]
    for f in families:
        codes = ", ".join(f"{code}: {count}" for code, count in sorted(f.codes.items(), key=lambda c: str(c[0])))
        memory = f"{f.memory_mb:.0f} MB" if f.memory_mb else ""
        seconds = f"{f.seconds:.1f} s" if f.seconds else ""
        lines.append(f"| {f.name} | {f.tried} | {codes} | {memory} | {seconds} | {len(f.bad)} |")
    bad = [f"- {f.name}: {sentence}" for f in families for sentence in f.bad]
    return "\n".join(lines + (["", "Bad:", ""] + bad if bad else [])) + "\n"
