#!/usr/bin/env python3
"""Wrap comment lines of Rust files that are wider than 100 columns; rustfmt leaves them as they are.

usage: wrap_comments.py [FILE...]      (without files: all that git tracks)

A line that is too long is broken, and what is left over goes before the next line of its paragraph. Code blocks,
tables, headings and lines without a blank to break at stay as they are, and so do lines of a text that goes on.
"""
import re
import subprocess
import sys

WIDTH = 100
COMMENT = re.compile(r"^(\s*)(//[/!]?)( ?)(.*)$")
# What begins a new paragraph of a comment.
FRESH = re.compile(r"^(\s*([-*+] |\d+[.)] |#|\||```|>)|\s{4,}|$)")


def parts(line):
    match = COMMENT.match(line)
    return match and (match[1] + match[2], match[4])


def broken(prefix, text):
    """The first line's text and what is left over."""
    room = WIDTH - len(prefix) - 1
    # No break within a code span or a link.
    depth, code, at = 0, False, None
    for i, c in enumerate(text):
        code ^= c == "`"
        depth += (c == "[") - (c == "]")
        if c == " " and not code and depth <= 0 and (i <= room and text[:i].strip()):
            at = i
    return (text, "") if at is None else (text[:at], text[at + 1 :].lstrip())


def wrapped(lines):
    out, k, fenced = [], 0, None
    while k < len(lines):
        line = lines[k]
        k += 1
        # After a line that ends with a backslash it is no comment but text.
        found = parts(line) if k < 2 or not lines[k - 2].endswith("\\") else None
        if not found:
            fenced = None
            out.append(line)
            continue
        prefix, text = found
        if text.lstrip().startswith("```"):
            fenced = None if fenced else prefix
        literal = fenced or text.lstrip().startswith(("|", "#", "```")) or text.startswith("    ")
        if len(line) <= WIDTH or literal or "http" in text:
            out.append(line)
            continue
        # A list's further lines keep its indent.
        indent = re.match(r"^\s*(?:[-*+] |\d+[.)] )?", text)[0]
        head, rest = broken(prefix, text)
        out.append(f"{prefix} {head}")
        if not rest:
            continue
        hang = " " * len(indent)
        following = parts(lines[k]) if k < len(lines) else None
        joins = following and following[0] == prefix and not FRESH.match(following[1].lstrip() if hang else following[1])
        if joins:
            lines[k] = f"{prefix} {hang}{rest} {following[1].lstrip()}"
        else:
            lines.insert(k, f"{prefix} {hang}{rest}")
    return out


def main(names):
    listed = ["git", "ls-files", "*.rs"]
    for name in names or subprocess.run(listed, capture_output=True, text=True, check=True).stdout.split():
        with open(name, encoding="utf8") as file:
            old = file.read()
        new = "\n".join(wrapped(old.split("\n")))
        if new != old:
            with open(name, "w", encoding="utf8") as file:
                file.write(new)
            print(name)


if __name__ == "__main__":
    if {"-h", "--help"} & set(sys.argv[1:]):
        sys.exit(__doc__)
    main(sys.argv[1:])
