"""Findings: what a bake leaves out or takes over differently, counted and by name."""

from dataclasses import dataclass, field

# Kinds of findings.
LEFT_OUT, CHANGED, PROBLEM = "LEFT_OUT", "CHANGED", "PROBLEM"
# A sentence lists so many names, and counts the others.
LISTED = 10


def counted(number, noun):
    """Returns a number with its noun: 1 body, 2 bodies."""
    if number == 1:
        return f"1 {noun}"
    endings = {"y": (noun[:-1], "ies"), "h": (noun, "es")}
    stem, ending = endings.get(noun[-1], (noun, "s"))
    return f"{number} {stem}{ending}"


@dataclass
class Finding:
    """A remark on objects of one kind: a number with its noun, and a text that follows.

    Without a noun the text is a sentence of its own.
    """

    kind: str
    noun: str
    text: str
    names: list = field(default_factory=list)
    # One case in full.
    detail: str = ""
    # Name of an operator that mends it, given the names of the objects.
    remedy: str = ""

    def line(self):
        """Returns the remark with the number of objects."""
        return f"{counted(len(self.names), self.noun)}{self.text}" if self.noun else self.text

    def sentence(self):
        """Returns the remark with names."""
        more = f" and {len(self.names) - LISTED} more" if len(self.names) > LISTED else ""
        names = ", ".join(f"'{name}'" for name in self.names[:LISTED])
        return f"{self.line()}: {names}{more}" if self.noun else self.line()


class Findings:
    """A list of findings in the order of their first mention."""

    def __init__(self):
        self._found = {}

    def add(self, kind, noun, text, *names, detail="", remedy=""):
        found = Finding(kind, noun, text, detail=detail, remedy=remedy)
        finding = self._found.setdefault((noun, text), found)
        finding.names = list(dict.fromkeys(finding.names + list(names)))

    def withdraw(self, noun, text, name):
        """Takes a name from a finding, and the finding away with the last one."""
        finding = self._found.get((noun, text))
        if finding and name in finding.names:
            finding.names.remove(name)
            if not finding.names:
                del self._found[noun, text]

    def __iter__(self):
        return iter(self._found.values())

    def __len__(self):
        return len(self._found)
