"""A reader of Prometheus' text format, version 0.0.4, after its specification
(prometheus.io/docs/instrumenting/exposition_formats): every line is read, and everything that the
specification forbids is an error."""

import re

NAME = re.compile(r"[a-zA-Z_:][a-zA-Z0-9_:]*")
LABEL = re.compile(r"[a-zA-Z_][a-zA-Z0-9_]*")
NUMBER = re.compile(r"NaN|[+-]Inf|[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
KINDS = ("counter", "gauge", "histogram", "summary", "untyped")


def labels_of(text):
    """{"name": "value"} of what stands between braces."""
    labels, at = {}, 0
    while at < len(text):
        name = LABEL.match(text, at)
        if not name or text[name.end() : name.end() + 2] != '="' or name[0] in labels:
            raise ValueError(f"no label at {text[at:]!r}")
        value, at = "", name.end() + 2
        while text[at] != '"':
            if text[at] == "\\":
                at += 1
                value += {"\\": "\\", '"': '"', "n": "\n"}[text[at]]
            else:
                value += text[at]
            at += 1
        labels[name[0]] = value
        at += 1
        if at < len(text):
            if text[at] != ",":
                raise ValueError(f"no comma at {text[at:]!r}")
            at += 1
    return labels


def parse(text):
    """{(name, frozenset of labels): value}, and {name: kind}."""
    if not text.endswith("\n"):
        raise ValueError("the last line has no end")
    samples, kinds, helps, group = {}, {}, set(), None
    ended, sampled = set(), set()
    for line in text[:-1].split("\n"):
        try:
            if line.startswith("# HELP "):
                _, _, name, what = line.split(" ", 3)
                if name in helps or not NAME.fullmatch(name) or re.search(r"\\(?![\\n])", what):
                    raise ValueError("not a HELP")
                helps.add(name)
            elif line.startswith("# TYPE "):
                _, _, name, kind = line.split(" ")
                if name in kinds or name in sampled or not NAME.fullmatch(name) or kind not in KINDS:
                    raise ValueError("not a TYPE, or after a sample")
                kinds[name] = kind
            else:
                name = NAME.match(line)[0]
                rest = line[len(name) :]
                labels = {}
                if rest.startswith("{"):
                    inside, rest = re.fullmatch(r'\{((?:[^"}]|"(?:[^"\\]|\\.)*")*)\}( .*)', rest).groups()
                    labels = labels_of(inside)
                value = rest.removeprefix(" ")
                if not NUMBER.fullmatch(value) or rest == value:
                    raise ValueError("not a value")
                key = name, frozenset(labels.items())
                if key in samples:
                    raise ValueError("twice")
                samples[key] = float(value)
                sampled.add(name)
            if name != group:
                if name in ended:
                    raise ValueError("not beside the others of its name")
                ended.add(group)
                group = name
        except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{line!r}: {error}") from error
    return samples, kinds
