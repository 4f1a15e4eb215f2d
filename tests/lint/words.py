#!/usr/bin/env -S python3 -B
"""Checks that the project's texts are plain technical English: no words of the stage, no sentence that must be read twice.

Prints file:line: the word: what to write, for every finding in the tracked text files. Identifiers count as words. It
checks first words of comments and of docstrings, and the length of sentences in the documents and in C++ headers.
It also refuses the markers of a merge conflict.
Usage: words.py [FILE ...]   (default: all tracked files)"""

import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
LONGEST_SENTENCE = 40

# Other people's text, recorded data, the changelog, and this table of words.
NOT_OURS = re.compile(r"tests/fuzz/seeds/|CHANGELOG\.md$|LICENSE$|package-lock\.json$|tests/lint/words\.py$|.*\.(log|csv|svg)$")

INSTEAD = {
    r"nobody": "no one, or the thing that is missing (no node, no sender)",
    r"somebody(?:'s)?": "the sender, the peer, another process",
    r"someone": "the sender, the peer, another process",
    r"whoever": "a user who, a node that",
    r"strangers?": "unknown sender, unauthenticated peer",
    r"anew": "again",
    r"likewise": "also, in the same way",
    r"alike": "the same, similar, both",
    r"besides": "also, in addition, other than",
    r"so long(?! that)": "as long as, for this long",
    r"(?:is|are|was|were) none of": "is not one of",
    r"(?:which|that|who|it|what|this|and|or|but) (?:is|are|was|were) none": "does not exist, is not one, has none",
    r"(?:is|are|was|were|be|been|being) told": "receives, is notified, reads",
    r"(?:is|are|was|were) said to": "is reported to, must",
    r"without rest": "divides, is a multiple of",
    r"(?:of|by|for) somebody(?: else)?": "another sender's, another process's",
    r"of (?:yours|theirs|its own making)": "your own, external",
    r"by hand": "manually, or what does not happen automatically",
}
# Counters, fields, keys and outputs that programs and logs outside the project read.
PUBLIC = re.compile(r"[\"`]stranger[\"`]|\b\w+\.anew\b|boolean anew\[")

WORD = re.compile("|".join(rf"(?P<w{i}>(?<![a-z])(?:{p})(?![a-z]))" for i, p in enumerate(INSTEAD)), re.IGNORECASE)
# A part of each of these words: most lines have none, and a search for these is many times faster than the patterns.
PARTS = ("nobody", "somebody", "someone", "whoever", "stranger", "anew", "likewise", "alike", "besides", "so long", "s none",
         "e none", " told", "said to", "without rest", "yours", "theirs", "its own making", "by hand")  # fmt: skip
IN_NAMES = re.compile(r"(?:Nobody|Somebody|Stranger|Anew|Whoever|Likewise|Alike|(?:Is|Are|Was)Told|SoLong|ByHand|SaidTo)(?![a-z])")
OPENING = re.compile(r"(?:of|what|that|those|whoever|for which|as)\b", re.IGNORECASE)
OPENS = "the subject: a noun, or a verb in the third person"
MARKERS = ("<" * 7, ">" * 7, "|" * 7, "=" * 7)
MARKER = re.compile(r"(?:<{7}|>{7}|\|{7})(?: |$)|={7}$")
COMMENT = {".hpp": r"///?<?", ".cpp": r"///?<?", ".js": r"//", ".mjs": r"//", ".lcm": r"//", ".py": r"#", ".sh": r"#",
           ".txt": r"#", ".cmake": r"#", ".toml": r"#", ".service": r"#", ".conf": r"#"}  # fmt: skip
KEY_MEANING = re.compile(r"\| `[^`]+` \| (?:`[^`]*`)? ?\| [^|]* \| ([^|]*) \|")


def tracked():
    listed = subprocess.run(["git", "-C", ROOT, "ls-files", "-z"], check=True, capture_output=True, text=True).stdout
    return [name for name in listed.split("\0") if name]


def words(text, lines):
    lower = text.lower()
    if not any(part in lower for part in PARTS) and not IN_NAMES.search(text):
        return
    for number, line in enumerate(lines, 1):
        lower = line.lower()
        if any(part in lower for part in PARTS) and not PUBLIC.search(line):
            for match in WORD.finditer(line):
                yield number, match[0], list(INSTEAD.values())[int(match.lastgroup[1:])]
        for match in IN_NAMES.finditer(line):
            yield number, match[0], "the plain word of that meaning in the name"


def markers(lines):
    for number, line in enumerate(lines, 1):
        if line[:7] in MARKERS and MARKER.match(line):
            yield number, line[:7], "the result of the merge"


def comment_blocks(lines, sign):
    """Yields (number of the first line, lines of text) of each block of comments.

    A comment behind code goes on in the lines below it that have nothing else, at the same column."""
    comment = re.compile(rf"(?P<code>\s*|.*\S {{2,}}){sign}(?: (?P<text>.*)|$)")
    block, first, column = [], 0, 0
    for number, line in enumerate([*lines, ""], 1):
        match = comment.match(line) if sign[:1] in line else None
        if match and block and not match["code"].strip() and len(match["code"]) == column:
            block.append(match["text"] or "")
            continue
        if block:
            yield first, block
        block = []
        if match:
            block, first, column = [match["text"] or ""], number, len(match["code"])


def docstrings(lines):
    for number, line in enumerate(lines, 1):
        if match := re.match(r'\s*"""(.*)', line):
            yield number, [match[1]]


def openings(name, suffix, lines):
    blocks = []
    if sign := COMMENT.get(suffix):
        blocks += comment_blocks(lines, sign)
    if suffix == ".py":
        blocks += docstrings(lines)
    for number, block in blocks:
        if match := OPENING.match(block[0]):
            yield number, f"begins with “{match[0]}”", OPENS
    if name == "docs/reference/keys.md":
        for number, line in enumerate(lines, 1):
            if (match := KEY_MEANING.match(line)) and (opening := OPENING.match(match[1])):
                yield number, f"begins with “{opening[0]}”", OPENS
    if name == "docs/reference/commands.md":
        for number, line in enumerate(lines, 1):
            option = re.match(r"  -\S.*|  [a-z][a-z-]*  ", lines[number - 2]) if number > 1 else None
            alone = option and "   " not in lines[number - 2].strip() and re.match(r" {20,}(.*)", line)
            if match := alone or re.match(r"  -.*?\S {2,}(\S.*)", line):
                if opening := OPENING.match(match[1]):
                    yield number, f"begins with “{opening[0]}”", OPENS


def paragraphs(lines, suffix):
    """Yields (number of the first line, text) of prose."""
    if suffix == ".md":
        fenced, block, first = False, [], 0
        for number, line in enumerate([*lines, ""], 1):
            fence = line.startswith("```")
            fenced ^= fence
            plain = not (fenced or fence or not line.strip() or re.match(r"\s*[|#<!]|    \s*\S", line))
            item = re.match(r"\s*(?:[-*]|\d+\.) ", line)
            if block and (not plain or item):
                yield first, " ".join(block)
                block = []
            if plain:
                first = first if block else number
                block.append(line.strip())
    else:
        for number, block in comment_blocks(lines, COMMENT[suffix]):
            part, first = [], number
            for offset, line in enumerate([*block, ""]):
                if not line.strip() or re.match(r"\s*[-*] |\s+", line):
                    if part:
                        yield first, " ".join(part)
                    part = []
                if line.strip():
                    first = first if part else number + offset
                    part.append(line.strip())


def sentences(suffix, lines):
    for number, text in paragraphs(lines, suffix):
        text = re.sub(r"\]\([^)]*\)", "]", text)
        for sentence in re.split(r"(?<=[.!?:;])[\"')*]* +(?=[A-Z`\"[(*])|(?<=[:;]) +", text):
            count = len(re.findall(r"(?<!\S)\S*\w\S*", sentence))
            if count > LONGEST_SENTENCE:
                yield number, f"{count} words: {' '.join(sentence.split()[:6])} …", f"two sentences, each below {LONGEST_SENTENCE} words"


def findings(name):
    path = ROOT / name
    try:
        text = path.read_text()
    except (UnicodeDecodeError, IsADirectoryError, FileNotFoundError):
        return
    lines, suffix = text.splitlines(), path.suffix
    yield from words(text, lines)
    yield from markers(lines)
    yield from openings(name, suffix, lines)
    if suffix == ".hpp" or (suffix == ".md" and name != "docs/reference/commands.md"):
        yield from sentences(suffix, lines)


def main():
    names = sys.argv[1:] or tracked()
    count = 0
    for name in names:
        if NOT_OURS.match(name):
            continue
        for number, said, instead in sorted(findings(name)):
            print(f"{name}:{number}: {said}: write {instead}")
            count += 1
    return 1 if count else 0


if __name__ == "__main__":
    sys.exit(main())
