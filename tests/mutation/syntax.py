"""Finds places in a C++ source to break, one at a time, and writes all of them into one copy of it
that a number chooses from at run time.

This reads the project's own style as clang-format writes it (binary operators have spaces around
them), which is a small part of C++; what it does not know stays as it is. An alternative that does
not compile is left out by the compiler's caller (see Mutated.without).

Operators; each mutant is one of them at one place:
  true, false    a condition, or what a function of type bool returns, is that
  operand        one operand of && or || does not count
  boundary       < becomes <=, > becomes >=, and the other way round
  negate         == and != elsewhere than in a condition; true and false
  drop           a statement is left out: an assignment, a call
  return         a function returns {} instead
  arithmetic     + becomes -, * becomes /, and the other way round; or the right operand is left out
  choice         std::min, max and clamp give one of their arguments, or leave one out
  special        what rules.py asks for
"""

import re
from dataclasses import dataclass

TOKEN = re.compile(
    r"""(?P<skip>\s+|//[^\n]*|/\*.*?\*/|^[ ]*\#(?:[^\n\\]|\\.)*)
      | (?P<word>[A-Za-z_]\w*) | (?P<number>\.?\d(?:[\w.']|(?<=[eE])[-+])*)
      | (?P<text>"(?:\\.|[^"\\])*" | '(?:\\.|[^'\\])+')
      | (?P<sign><=>|<<=|>>=|\.\.\.|::|->|\+\+|--|<<|>>|<=|>=|==|!=|&&|\|\||[-+*/%&|^]=|.)""",
    re.VERBOSE | re.MULTILINE | re.DOTALL,
)
CLOSES = {"(": ")", "[": "]", "{": "}"}
BOUNDARY = {"<": "<=", "<=": "<", ">": ">=", ">=": ">"}
ARITHMETIC = {"+": "-", "-": "+", "*": "/", "/": "*"}
NOTHING = {"{}", '""', "std::nullopt", "nullptr", "0", "0.0", "false"}


@dataclass
class Mutant:
    function: str
    operator: str
    text: str  # changed text, without line breaks
    line: int
    file: str = ""
    number: int = 0

    def key(self):
        return (self.function, self.operator, self.text)

    def __str__(self):
        return f"{self.file}:{self.line}: {self.function}: {self.operator}: {self.text}"


@dataclass
class Token:
    kind: str
    text: str
    start: int
    end: int


class Mutated:
    """A source with mutants numbered from `first` on. `text` is the copy, in which tether_mutant(n)
    chooses; without: numbers to leave out."""

    PRELUDE = 'extern "C" bool tether_mutant(int);\n'

    def __init__(self, source, first, without=frozenset(), special=()):
        """special: (name, function, find, replace), regular expressions but for `replace`."""
        self.source, self.first, self.without, self.special = source, first, without, special
        self.mutants = []
        self.tokens = [
            Token(m.lastgroup, m[0], m.start(), m.end())
            for m in TOKEN.finditer(source)
            if m.lastgroup != "skip"
        ]
        self.partner = {}
        opened = []
        for i, token in enumerate(self.tokens):
            if token.kind == "sign" and token.text in CLOSES:
                opened.append(i)
            elif token.kind == "sign" and token.text in CLOSES.values():
                self.partner[opened.pop()] = i
        self.edits = []  # (start, end, text) of the function bodies
        self.function = ""
        self._scope(0, len(self.tokens), "")
        self.text = self.PRELUDE + self._edited()

    def _edited(self):
        text, at = [], 0
        for start, end, new in self.edits:
            text += [self.source[at:start], new]
            at = end
        return "".join(text) + self.source[at:]

    # --- pieces of the source

    def _is(self, i, *texts):
        return i < len(self.tokens) and self.tokens[i].kind != "text" and self.tokens[i].text in texts

    def _raw(self, lo, hi):
        return self.source[self.tokens[lo].start : self.tokens[hi - 1].end] if lo < hi else ""

    def _gap(self, i):
        """Between a token and the one before it."""
        return self.source[self.tokens[i - 1].end : self.tokens[i].start] if i else ""

    def _join(self, lo, pieces):
        """Rendered pieces (first token, text), with what lies between them."""
        return "".join((self._gap(i) if i != lo else "") + text for i, text in pieces)

    def _top_level(self, lo, hi):
        """Token numbers outside of brackets; an opening bracket counts."""
        i = lo
        while i < hi:
            yield i
            i = self.partner.get(i, i) + 1

    def _split(self, lo, hi, *signs):
        """The ranges between these signs."""
        begin = lo
        for i in self._top_level(lo, hi):
            if self._is(i, *signs):
                yield begin, i
                begin = i + 1
        yield begin, hi

    def _binary(self, i, lo, hi, *signs):
        """Whether this token is such a binary operator."""
        if not (lo < i < hi - 1 and self._is(i, *signs)):
            return False
        around = self._gap(i), self._gap(i + 1)
        return all(around) and not self._is(i - 1, "template", "return", ",", "(", "=", "operator")

    def _mutant(self, operator, lo, hi, text=None):
        """Its number, as a call that says whether it is active; None if it is left out."""
        text = self._raw(lo, hi) if text is None else text
        line = self.source.count("\n", 0, self.tokens[lo].start) + 1
        number = self.first + len(self.mutants)
        self.mutants.append(
            Mutant(self.function, operator, " ".join(text.split()), line, number=number)
        )
        return None if number in self.without else f"tether_mutant({number})"

    # --- scopes and functions

    def _scope(self, lo, hi, name):
        """Declarations: of a namespace, a class or the file."""
        head = i = lo
        while i < hi:
            if self._is(i, ";") or (self._is(i, ":") and self._is(i - 1, "public", "private", "protected")):
                head = i + 1
            elif self._is(i, "{"):
                end = self.partner[i]
                words = [self.tokens[k].text for k in range(head, i)]
                if "namespace" in words or (words and words[0] == "extern"):
                    self._scope(i + 1, end, name)
                elif {"class", "struct", "union"} & set(words) and "(" not in words:
                    self._scope(i + 1, end, name + self._class_name(words) + "::")
                elif "(" in words and self._begins_body(head, i):
                    if not {"constexpr", "consteval"} & set(words):
                        self._function(head, i, end, name)
                else:  # an initialiser, also of a member in a constructor's list
                    i = end + 1
                    continue
                head = end + 1
                i = end
            i = self.partner.get(i, i) + 1

    @staticmethod
    def _class_name(words):
        return next((w for w in words[1:] if re.match(r"[A-Za-z_]\w*$", w) and w != "final"), "")

    def _begins_body(self, head, i):
        if "=" in [self.tokens[k].text for k in self._top_level(head, i) if self.tokens[k].kind == "sign"]:
            return self._is(i - 1, ")") and any(self._is(k, "operator") for k in range(head, i))
        if self.tokens[i - 1].kind == "word":
            return self._is(i - 1, "const", "noexcept", "override", "final", "try")
        return True

    def _function(self, head, body, end, scope):
        paren = next(k for k in self._top_level(head, body) if self._is(k, "("))
        first = paren - 1
        while first > head and (self._is(first - 1, "::", "~") or self._is(first, "::")):
            first -= 1
        self.function = scope + "".join(t.text for t in self.tokens[first:paren])
        outer = self.source[self.tokens[head].start : self.tokens[first].start].split()
        self.returns = " ".join(w for w in outer if w not in ("static", "inline", "virtual", "[[nodiscard]]"))
        initialisers = self.partner[paren] + 1
        if self._is(initialisers, ":"):
            text = self._primary(initialisers, body)
            self.edits.append((self.tokens[initialisers].start, self.tokens[body - 1].end, text))
        self.edits.append((self.tokens[body].start, self.tokens[end].end, self._compound(body)))

    # --- statements

    def _compound(self, opening):
        """{ statements }"""
        end = self.partner[opening]
        pieces, i = [(opening, "{")], opening + 1
        while i < end:
            begin = i
            i, text = self._statement(i, end, in_compound=True)
            pieces.append((begin, text))
        return self._join(opening, [*pieces, (end, "}")])

    def _statement(self, i, hi, in_compound=False):
        """The token after it, and its text."""
        if self._is(i, "{"):
            return self.partner[i] + 1, self._compound(i)
        if self._is(i, "if", "while", "for", "switch") or (self._is(i, "catch")):
            return self._controlled(i, hi)
        if self._is(i, "else", "do", "try"):
            after, text = self._statement(i + 1, hi)
            return after, self._raw(i, i + 1) + self._gap(i + 1) + text
        if self._is(i, "case", "default"):
            colon = next(k for k in range(i, hi) if self._is(k, ":"))
            return colon + 1, self._raw(i, colon + 1)
        end = next((k for k in self._top_level(i, hi) if self._is(k, ";")), hi - 1)
        return end + 1, self._simple(i, end, in_compound) + self._raw(end, end + 1)

    def _controlled(self, i, hi):
        paren = next(k for k in range(i, hi) if self._is(k, "("))
        close = self.partner[paren]
        head = self._head(self.tokens[i].text, paren + 1, close) if paren == i + 1 else self._raw(paren + 1, close)
        after, body = close + 1, ""
        if not self._is(after, ";"):
            gap = self._gap(after)
            after, body = self._statement(after, hi)
            body = gap + body
        return after, self._raw(i, paren + 1) + head + ")" + body

    def _head(self, keyword, lo, hi):
        if keyword == "switch":
            return self._expression(lo, hi)
        if keyword in ("for", "catch"):
            return self._loop_head(lo, hi)
        *before, (begin, end) = self._split(lo, hi, ";")
        prefix = self.source[self.tokens[lo].start : self.tokens[begin].start] if before else ""
        equals = [k for k in self._top_level(begin, end) if self._is(k, "=")]
        if equals:
            at = equals[0] + 1
            text = prefix + self._raw(begin, at) + self._gap(at) + self._expression(at, end)
            never = None if before else self._mutant("false", begin, end)
            return f"{text}; !{never} && ({self.tokens[at - 2].text})" if never else text
        return prefix + self._condition(begin, end, may_be_true=keyword == "if")

    def _loop_head(self, lo, hi):
        parts = list(self._split(lo, hi, ";"))
        if len(parts) != 3 or parts[1][0] == parts[1][1]:
            return self._raw(lo, hi)
        begin, end = parts[1]
        text = self._raw(begin, end)
        for call, other in self._specials(begin, end):
            text = f"({call} ? ({other}) : ({text}))"
        return self.source[self.tokens[lo].start : self.tokens[begin].start] + text + self.source[
            self.tokens[end - 1].end : self.tokens[hi - 1].end]

    def _specials(self, lo, hi):
        """(call, other text) of those that rules.py asks for here."""
        for name, function, find, replace in self.special:
            text = " ".join(self._raw(lo, hi).split())
            if re.search(function, self.function) and re.search(find, text):
                call = self._mutant("special", lo, hi, f"{name}: {text}")
                if call:
                    yield call, re.sub(find, lambda _: replace, text)

    def _condition(self, lo, hi, may_be_true=True):
        always = self._mutant("true", lo, hi) if may_be_true else None
        never = self._mutant("false", lo, hi)
        text = self._expression(lo, hi, is_condition=True)
        text = f"(!{never} && ({text}))" if never else text
        return f"({always} || {text})" if always else text

    def _simple(self, lo, hi, in_compound):
        """A statement without its semicolon."""
        if lo == hi or self._is(lo, "break", "continue", "assert", "static_assert", "using", "constexpr",
                                "static", "throw"):
            return self._raw(lo, hi)
        if self._is(lo, "return"):
            return self._return(lo, hi, in_compound)
        if self._declares(lo, hi):
            equals = next((k for k in self._top_level(lo, hi) if self._is(k, "=")), None)
            if equals is None:
                return self._primary(lo, hi)
            text = self._value(equals + 1, hi)
            for call, other in self._specials(equals + 1, hi):
                text = f"(\n{call} ? ({other}) :\n ({text}))"
            return self._raw(lo, equals + 1) + self._gap(equals + 1) + text
        dropped = self._mutant("drop", lo, hi)
        specials = list(self._specials(lo, hi))
        text = self._expression(lo, hi)
        for call, other in specials:
            text = f"\n{call} ? (void)({other}) :\n (void)({text})"
        return f"({dropped} ? (void)0 : (void)({text}))" if dropped else text

    def _value(self, lo, hi):
        """Parts of an assignment or initialisation: as a condition if it clearly is of type bool."""
        level = [k for k in self._top_level(lo, hi)]
        if any(self._is(k, "?", "=") for k in level) or "[" in [self.tokens[k].text for k in level]:
            return self._expression(lo, hi)
        if self._comparison(lo, hi) or any(self._binary(k, lo, hi, "||", "&&") for k in level):
            return self._condition(lo, hi)
        return self._expression(lo, hi)

    def _declares(self, lo, hi):
        """Two names in a row, with at most template arguments and * & between them."""
        text = self._raw(lo, hi)
        return re.match(r"(const|auto|struct)\b|[\w:]+(<[^;=()]*>)?[*&]*\s+[*&]*\w+\s*([=({;,\[]|$)", text)

    def _return(self, lo, hi, in_compound):
        text = self._raw(lo + 1, hi)
        if not text:
            return self._raw(lo, hi)
        if self.returns == "void":
            dropped = self._mutant("drop", lo + 1, hi)
            value = self._expression(lo + 1, hi)
            return f"return {dropped} ? (void)0 : (void)({value})" if dropped else f"return {value}"
        if self.returns == "bool" and text not in ("true", "false"):
            value = self._condition(lo + 1, hi)
            for call, other in self._specials(lo + 1, hi):
                value = f"(\n{call} ? ({other}) :\n ({value}))"
            return "return " + value
        others = list(self._specials(lo + 1, hi))
        if self.returns not in ("", "bool") and "&" not in self.returns and text not in NOTHING:
            others.append((self._mutant("return", lo + 1, hi), "{}"))
        value = f"return {self._expression(lo + 1, hi)}"
        if self._is(hi + 1, "else"):
            return value
        early = "".join(f"\nif ({call}) return {other};\n" for call, other in others if call)
        if not in_compound and early:
            return f"{{ {early}{value}; }}"
        return early + value

    # --- expressions

    def _expression(self, lo, hi, is_condition=False):
        if lo >= hi:
            return ""
        for k in self._top_level(lo, hi):
            if self._is(k, "=", "+=", "-=", "*=", "/=", "|=", "&=") and lo < k < hi - 1 and self._gap(k):
                return self._raw(lo, k + 1) + self._gap(k + 1) + self._value(k + 1, hi)
        question = next((k for k in self._top_level(lo, hi) if self._is(k, "?")), None)
        if question:
            return self._ternary(lo, question, hi)
        for sign, neutral in (("||", "(!{} && ({}))"), ("&&", "({} || ({}))")):
            at = [k for k in self._top_level(lo, hi) if self._binary(k, lo, hi, sign)]
            if at:
                return self._logical(lo, hi, at, neutral)
        if self._is(lo, "!") and not self._comparison(lo, hi):
            return "!" + self._expression(lo + 1, hi, is_condition)
        if at := self._comparison(lo, hi):
            return self._compared(lo, at, hi, is_condition)
        for signs in (("+", "-"), ("*", "/", "%")):
            at = [k for k in self._top_level(lo, hi) if self._binary(k, lo, hi, *signs)]
            if at:
                return self._calculated(lo, at[-1], hi)
        return self._primary(lo, hi)

    def _ternary(self, lo, question, hi):
        depth = 0
        for colon in self._top_level(question + 1, hi):
            depth += self._is(colon, "?") - self._is(colon, ":")
            if depth < 0:
                break
        parts = [
            (lo, self._condition(lo, question)),
            (question, "?"),
            (question + 1, self._expression(question + 1, colon)),
            (colon, ":"),
            (colon + 1, self._expression(colon + 1, hi)),
        ]
        return self._join(lo, parts)

    def _logical(self, lo, hi, signs, neutral):
        pieces, begin = [], lo
        for end in [*signs, hi]:
            ignored = self._mutant("operand", begin, end)
            text = self._expression(begin, end, is_condition=True)
            pieces.append((begin, neutral.format(ignored, text) if ignored else text))
            if end != hi:
                pieces.append((end, self.tokens[end].text))
            begin = end + 1
        return self._join(lo, pieces)

    def _comparison(self, lo, hi):
        at = [k for k in self._top_level(lo, hi) if self._binary(k, lo, hi, "==", "!=", *BOUNDARY)]
        return at[-1] if at else None

    def _compared(self, lo, at, hi, is_condition):
        sign = self.tokens[at].text
        left, right = self._expression(lo, at), self._expression(at + 1, hi)
        text = f"{left} {sign} {right}"
        if sign in BOUNDARY:
            if other := self._mutant("boundary", lo, hi):
                swapped = f"{self._raw(lo, at)} {BOUNDARY[sign]} {self._raw(at + 1, hi)}"
                text = f"(\n{other} ? ({swapped}) :\n ({text}))"
        elif not is_condition and (other := self._mutant("negate", lo, hi)):
            text = f"({other} != ({text}))"
        return text

    def _calculated(self, lo, at, hi):
        sign = self.tokens[at].text
        raw_left, raw_right = self._raw(lo, at), self._raw(at + 1, hi)
        swapped = dropped = None
        if sign in ARITHMETIC and '"' not in self._raw(lo, hi):
            swapped = self._mutant("arithmetic", lo, hi, f"{self._raw(lo, hi)} to {ARITHMETIC[sign]}")
            dropped = self._mutant("arithmetic", lo, hi, f"{self._raw(lo, hi)} to {raw_left}")
        text = f"{self._expression(lo, at)} {sign} {self._expression(at + 1, hi)}"
        for call, other in ((swapped, f"{raw_left} {ARITHMETIC.get(sign)} {raw_right}"), (dropped, raw_left)):
            if call:
                text = f"(\n{call} ? ({other}) :\n ({text}))"
        return text

    def _primary(self, lo, hi):
        """Names, calls, braces: what is in brackets is looked at, what is outside stays."""
        if (choice := self._choice(lo, hi)) is not None:
            return choice
        pieces, i = [], lo
        while i < hi:
            if self._is(i, "(", "{", "[") and i in self.partner:
                end = self.partner[i]
                pieces.append((i, self._bracket(lo, i, end)))
                i = end + 1
            else:
                text = self.tokens[i].text
                if self._is(i, "true", "false") and (flipped := self._mutant("negate", i, i + 1, self._context(lo, hi))):
                    text = f"({flipped} != {text})"
                pieces.append((i, text))
                i += 1
        return self._join(lo, pieces)

    def _context(self, lo, hi):
        return self._raw(max(lo - 2, 0), hi)

    def _bracket(self, lo, opening, end):
        if self._is(opening, "["):
            return self._raw(opening, end + 1)  # a subscript, or what a lambda captures
        lambda_body = self._is(opening, "{") and opening > lo and (
            self._is(opening - 1, "]", "mutable")
            or self._is(opening - 1, ")") and self._is(self._opening(opening - 1) - 1, "]"))
        if lambda_body:
            returns, self.returns = self.returns, ""
            text = self._compound(opening)
            self.returns = returns
            return text
        if self._is(opening, "(") and opening > 0 and self._is(opening - 1, "]"):
            return self._raw(opening, end + 1)  # parameters
        if end == opening + 1:
            return self._raw(opening, end + 1)
        pieces = []
        for begin, stop in self._split(opening + 1, end, ","):
            if begin < stop:
                pieces.append((begin, self._expression(begin, stop)))
            if self._is(stop, ","):
                pieces.append((stop, ","))
        return self._join(opening, [(opening, self.tokens[opening].text), *pieces, (end, self.tokens[end].text)])

    def _opening(self, closing):
        return next(k for k, v in self.partner.items() if v == closing)

    def _choice(self, lo, hi):
        """std::min(a, b), std::max({a, b, c}), std::clamp(x, low, high), if that is all there is."""
        if not (self._is(lo, "std") and self._is(lo + 2, "min", "max", "clamp") and self._is(lo + 3, "(")
                and self.partner[lo + 3] == hi - 1):
            return None
        name = self.tokens[lo + 2].text
        opening = lo + 4 if self._is(lo + 4, "{") else lo + 3
        parts = list(self._split(opening + 1, self.partner[opening], ","))
        texts = [self._raw(*part) for part in parts]
        if opening != lo + 3:
            others = [f"std::{name}({{{', '.join(texts[:i] + texts[i + 1 :])}}})" for i in range(len(texts))]
        else:
            others = texts[:1] if name == "clamp" else texts
        calls = [(self._mutant("choice", lo, hi, f"{self._raw(lo, hi)} to {other}"), other) for other in others]
        text = self._raw(lo, opening) + self._bracket(lo, opening, self.partner[opening]) + self._raw(
            self.partner[opening] + 1, hi)
        for call, other in calls:
            if call:
                text = f"(\n{call} ? ({other}) :\n ({text}))"
        return text
