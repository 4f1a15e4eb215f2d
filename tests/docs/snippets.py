#!/usr/bin/env -S python3 -B
"""Runs a page's blocks of Python as one program, from top to bottom, and compares what stands behind "#" as a number,
a text or another literal with what the line prints or is worth; other comments are words. Blocks that are a file
(blocks.py) are not of it. tether.main does nothing, so that programs of laws can stand among them.
Usage: snippets.py PAGE"""

import ast
import contextlib
import io
import pathlib
import sys
import tokenize

import blocks
import tether


def told_by_line(text):
    """Expected output, by the line."""
    told = {}
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            words = token.string.lstrip("# ")
            with contextlib.suppress(ValueError, SyntaxError):
                ast.literal_eval(words)
                told[token.start[0]] = words
    return told


def comes_out(statement, names):
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        if isinstance(statement, ast.Expr):
            value = eval(compile(ast.Expression(statement.value), "page", "eval"), names)
            return said.getvalue().strip() if value is None else repr(value)
        exec(compile(ast.Module([statement], []), "page", "exec"), names)
    return said.getvalue().strip()


def main():
    page = pathlib.Path(sys.argv[1])
    tether.main = lambda *_, **__: None
    names, wrong = {"__name__": "page"}, 0
    for block in blocks.blocks_of(page):
        if block.mark != "python":
            continue
        told = told_by_line(block.file_text)
        for statement in ast.parse(block.file_text).body:
            said, words = comes_out(statement, names), told.pop(statement.end_lineno, None)
            if words is not None and said != words:
                print(f"line {block.line + statement.end_lineno - 1}: the page has {words}, but {said} comes out")
                wrong = 1
        for line in told:
            print(f"line {block.line + line - 1}: {told[line]} stands at no statement's end")
            wrong = 1
    return wrong


if __name__ == "__main__":
    sys.exit(main())
