"""Commands in documents, and their printed output.

A block of commands is an indented or fenced one that begins with a command. With "$ " before its commands, all
other lines are what they print; without, all lines are commands. In what is printed "[...]" stands for any lines
and "…" for anything within a line; white space counts as one blank, so that long lines may be broken.

A mark in an HTML comment above a block says how it is checked, if not by running it and comparing:
    <!-- check: digits -->            run; numbers may be others, for they depend on the machine or the clock
    <!-- check: nightly -->           takes long: run only with --nightly, else as parse
    <!-- check: parse (why) -->       not run: commands, options, keys and files have to be there
    <!-- first: COMMAND -->           this is run before; what stays in the background ends with the page
    <!-- file: NAME -->               no commands: the block is this file, for those that follow

Blocks of Python are run, too, unless they are a file: snippets.py says how.
    <!-- end of: FILE -->             and with these lines the checkout's FILE ends
"""

import dataclasses
import pathlib
import re
import shlex

PROGRAM = re.compile(
    r"\$ |(tether(-[a-z-]+)?|lcm-[a-z]+|cmake|ctest|cpack|sudo|python3|cd|mkdir|export|for|printf|gnuplot|parallel"
    r"|start=\S+|candump|chmod|head|ping|iperf3|docker)( |$)|PATH=|TETHER_|LCM_|\./"
    r"|(build|tests|tools|examples|bench)/\S"
)
MARK = re.compile(r"(?m)^<!-- check: (digits|nightly|parse)(?: \((.+)\))? -->$")


@dataclasses.dataclass
class Command:
    text: str
    printed: list  # its lines; None: not told


@dataclasses.dataclass
class Block:
    file: pathlib.Path
    line: int
    mark: str  # "" for none
    commands: list
    file_text: str = ""  # with marks "file" and "python": what is in it
    name: str = ""  # name of the file that it is, or of the one that ends with it


def lines_of_blocks(text):
    """(number of the first line, its lines without indentation, the comments above, its language or "") of each
    block of code."""
    lines = text.splitlines()
    i = 0

    def above(i):
        while i and not lines[i - 1].strip():
            i -= 1
        begin = i
        while begin and re.match(r"\s*<!-- .* -->$", lines[begin - 1]):
            begin -= 1
        return "\n".join(line.strip() for line in lines[begin:i])

    while i < len(lines):
        fence = re.match(r"(\s*)```(\w*)", lines[i])
        if fence:
            end = next(k for k in range(i + 1, len(lines)) if lines[k].startswith(fence[1] + "```"))
            yield i + 2, [line[len(fence[1]) :] for line in lines[i + 1 : end]], above(i), fence[2]
            i = end + 1
        elif re.match(" {4,}\\S", lines[i]) and (i == 0 or not lines[i - 1].strip() or "<!-- " in lines[i - 1]):
            indent = len(lines[i]) - len(lines[i].lstrip())
            end = i
            while end < len(lines) and (not lines[end].strip() or lines[end].startswith(" " * indent)):
                end += 1
            block = [line[indent:] for line in lines[i:end]]
            while block and not block[-1].strip():
                block.pop()
            yield i + 1, block, above(i), ""
            i = end
        else:
            i += 1


def goes_on(text):
    """Whether the shell would ask for another line."""
    try:
        shlex.split(text, comments=True)
        return text.endswith("\\")
    except ValueError:  # an open quotation, or a backslash at the end
        return True


def commands_of(lines):
    prompted = any(line.startswith("$ ") for line in lines)
    commands = []
    for line in lines:
        if commands and goes_on(commands[-1].text) and commands[-1].printed in (None, []):
            commands[-1].text += "\n" + line
        elif prompted and line.startswith("$ "):
            commands.append(Command(line[2:], []))
        elif prompted and not commands:
            raise ValueError(f"a command without \"$ \", in a block with it: {line}")
        elif prompted:
            commands[-1].printed.append(line)
        elif line.strip():
            commands.append(Command(line, None))
    return commands


def blocks_of(file):
    for number, lines, above, language in lines_of_blocks(file.read_text()):
        text = "\n".join(lines) + "\n"
        written = re.search(r"(?m)^<!-- (file|end of): (\S+) -->$", above)
        if written and written[1] == "file":
            yield Block(file, number, "file", [], text, written[2])
        elif language == "python":
            yield Block(file, number, "python", [], text, written[2] if written else "")
        elif lines and PROGRAM.match(lines[0]):
            mark = MARK.search(above)
            if "<!-- check" in above and not mark:
                raise ValueError(f"{file}:{number - 1}: not a mark that is known: {above.strip()}")
            if mark and mark[1] == "parse" and not mark[2]:
                raise ValueError(f"{file}:{number - 1}: say why: <!-- check: parse (why) -->")
            first = re.search(r"(?m)^<!-- first: (.+) -->$", above)
            prepared = [Command(first[1], None)] if first else []
            yield Block(file, number, mark[1] if mark else "", prepared + commands_of(lines))


def pattern_of(printed, any_digits):
    """The printed lines as a regular expression for words with one blank between them."""
    words = " ".join(printed).split()
    parts = []
    for word in words:
        if word in ("[...]", "…"):
            parts.append(r"(?:\S+ )*?")
            continue
        part = re.escape(word).replace("…", r"(?:…|.*?)")
        if any_digits:
            part = re.sub(r"(?:\\-)?\d+(?:\\\.\d+)?(?:e(?:\\-)?\d+)?", r"-?[\\d.]+(?:e-?\\d+)?", part)
        parts.append(part + " ")
    pattern = "".join(parts)
    # Run times differ between machines.
    return re.sub(r"simulated in \S+ s \S+ x", r"simulated in \\S+ s \\S+ x", pattern)


def agrees(block, command, said):
    words = "".join(word + " " for word in said.split())
    return re.fullmatch(pattern_of(command.printed, block.mark == "digits"), words) is not None
