"""Descriptions by the programs themselves: commands, options and keys, to check command lines against without running
them."""

import functools
import pathlib
import re
import shlex
import subprocess


def said_by(*command):
    return subprocess.run(command, capture_output=True, text=True, timeout=20, check=False).stdout


@functools.cache
def help_of(program, words):
    return said_by(program, *words, "--help")


@functools.cache
def options(program, words):
    listed = help_of(program, words).split("Options:")[-1]
    return set(re.findall(r"(?m)(?:^  |,)(--?[a-zA-Z][a-z0-9-]*)(?=[ ,\n])", listed))


@functools.cache
def subcommands(program, words):
    parts = help_of(program, words).split("\nSubcommands:\n")
    return re.findall(r"(?m)^  ([a-z][a-z-]*)(?= |$)", parts[1].split("\n\n")[0]) if len(parts) > 1 else []


def all_commands(program, words=()):
    """The words of a program's commands, itself first."""
    yield words
    for word in subcommands(program, words):
        yield from all_commands(program, (*words, word))


@functools.cache
def keys(bin_dir):
    return set(re.findall(r"(?m)^\s*([a-z_0-9]+(?:\.\w+)+)(?= |$)", said_by(bin_dir / "tether", "run", "--keys")))


def is_key(bin_dir, key):
    """Whether a scenario has the key. Shorthands and names that users give are not taken apart further."""
    if re.match(r"(channel\.(links|change)|fleet\.vehicle|world\.obstacle|medium\.background)\b", key):
        return True
    both = re.sub(r"^channel\.(?!uplink\.|downlink\.)", "channel.uplink.", key)
    return key in keys(bin_dir) or both in keys(bin_dir)


def simple_commands(line):
    """The words of each program that a line of shell starts; [] for what is not taken apart."""
    try:
        lexer = shlex.shlex(line.replace("\\\n", " "), posix=True, punctuation_chars="|&;<>()")
        lexer.whitespace_split = True
        lexer.commenters = "#"
        words = list(lexer)
    except ValueError as error:
        raise ValueError(f"not a command line: {error}: {line}") from error
    command = []
    for word in [*words, ";"]:
        if word and all(c in "|&;()" for c in word):
            yield command
            command = []
        elif command or not re.match(r"[A-Za-z_]+=|do$|sudo$", word):
            command.append(word)


def wrong_with_words(bin_dir, root, words):
    """Errors in one program's texts; None if nothing is."""
    if not words:
        return None
    name = words[0]
    if re.match(r"(\./|tests/|tools/|examples/|bench/)", name) and not (root / name).exists():
        return f"there is no {name}"
    built = re.match(r"build/release/(bin|tests)/(\S+)", name)
    if built and not (bin_dir.parent / built[1] / built[2]).exists():
        return f"there is no {name}"
    base = pathlib.Path(name).name
    if not re.fullmatch(r"tether(-[a-z-]+)?", base):
        return None
    program, rest, path = bin_dir / base, words[1:], ()
    if base == "tether" and rest and (bin_dir / f"tether-{rest[0]}").exists():
        is_own = rest[0] in subcommands(program, ()) and (
            len(rest) < 2 or rest[1] in subcommands(program, (rest[0],)) or not re.search(r"[./]|^[A-Z-]", rest[1])
        )
        if not is_own:
            program, rest = bin_dir / f"tether-{rest[0]}", rest[1:]
    if not program.exists():
        return f"there is no program {base}"
    while rest and rest[0] in subcommands(program, path):
        path, rest = (*path, rest[0]), rest[1:]
    said = " ".join((program.name, *path))
    if rest and not rest[0].startswith(("-", "[")) and "[SUBCOMMAND]" not in help_of(program, path):
        if subcommands(program, path):
            return f"{said} has no command {rest[0]}"
    for before, word in zip([name, *rest], rest):
        if word == "--":  # another program's words follow
            break
        word = word.strip("[],")
        option = word.split("=")[0]
        if option.startswith("--") and option not in options(program, path):
            return f"{said} has no option {option}"
        if before == "--set" and "=" in word and not is_key(bin_dir, word.split("=")[0]):
            return f"there is no key {word.split('=')[0]}"
        if re.fullmatch(r"(scenarios|experiments|drivetrains)/\S+\.\w+", word) and not (root / word).exists():
            return f"there is no file {word}"
    return None


def wrong_with(bin_dir, root, line):
    """Error in a line of shell; None if there is none that shows without running it."""
    for words in simple_commands(line):
        wrong = wrong_with_words(bin_dir, root, words)
        if wrong:
            return wrong
    return None
