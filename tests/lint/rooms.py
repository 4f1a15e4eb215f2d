#!/usr/bin/env -S python3 -B
"""Each folder of sources is a room, and its CMakeLists.txt says truly which others it uses.

Fails, naming file and line, where a file includes a room that its own room does not declare (USES of
tether_add_room, or tether_rooms(uses ...)), where a declared room is not used, where rooms form a
cycle, where a top folder's arrow runs back up, and where two
types have one name: of their inline functions the linker keeps one, for both.
Usage: rooms.py [ROOT]"""

import pathlib
import re
import sys

# A room may use rooms of its own top folder and of those named here.
MAY_USE = {
    "common": set(),
    "sim": {"common"},
    "controller": {"common"},
    "netem": {"common"},
    "can_bridge": {"common"},
    "onboard": {"common", "controller"},
    "doors": {"common", "netem"},
    "tools": {"common", "sim", "controller", "netem", "can_bridge", "onboard", "doors"},
}

USES = re.compile(r"\bUSES\b([^()]*?)(?=\b(?:LIBS|PRIVATE_LIBS|SOURCES)\b|\))|\btether_rooms\(uses\s([^()]*)\)")
NAMESPACE = re.compile(r"namespace ?([\w:]*) ?{$")
TYPE = re.compile(r"(?:class|struct|union|enum class|enum) (\w+)(?: final)?(?: :(?!:).*)? {")
INCLUDE = re.compile(r'\s*#\s*include\s+"([^"]+)"')


class Room:
    def __init__(self, root, cmake):
        self.name = str(cmake.parent.relative_to(root))
        self.cmake = cmake.relative_to(root)
        text = re.sub(r"#.*", "", cmake.read_text())
        self.declared = {}  # room: line
        for match in USES.finditer(text):
            group = 1 if match[1] is not None else 2
            for word in re.finditer(r"\S+", match[group]):
                at = match.start(group) + word.start()
                self.declared[word[0]] = text.count("\n", 0, at) + 1
        self.included = {}  # room: the first place, "file:line"
        for source in sorted([*cmake.parent.glob("*.hpp"), *cmake.parent.glob("*.cpp")]):
            for number, line in enumerate(source.read_text().splitlines(), 1):
                if (match := INCLUDE.match(line)) and (root / match[1]).is_file():
                    other = str(pathlib.Path(match[1]).parent)
                    place = f"{source.relative_to(root)}:{number}: includes {match[1]}"
                    self.included.setdefault(other, place)
        self.included.pop(self.name, None)

    def top(self):
        return self.name.split("/")[0]


def is_room(cmake):
    return re.search(r"\btether_(add_room|rooms)\(", cmake.read_text())


def undeclared_and_unused(rooms):
    for room in rooms.values():
        for other, place in sorted(room.included.items()):
            if other not in room.declared:
                yield f"{place}, but {room.cmake} does not say USES {other}"
        for other, line in sorted(room.declared.items()):
            if other not in rooms:
                yield f"{room.cmake}:{line}: USES {other}, which is no room"
            elif other not in room.included:
                yield f"{room.cmake}:{line}: USES {other}, but no file in {room.name} includes it"


def arrows_back_up(rooms):
    for room in rooms.values():
        places = {o: f"{room.cmake}:{line}: USES {o}" for o, line in room.declared.items()}
        for other, place in sorted((places | room.included).items()):
            top = other.split("/")[0]
            if top != room.top() and top not in MAY_USE[room.top()]:
                allowed = ", ".join(sorted(MAY_USE[room.top()])) or "nothing else"
                yield f"{place}: {room.top()} may use {allowed}, not {top}"


def cycles(rooms):
    """Each as one line: the places that lead round."""
    done, path = set(), []

    def visit(name):
        if name in path:
            ring = path[path.index(name) :] + [name]
            yield "a cycle of rooms: " + "; ".join(rooms[a].included[b] for a, b in zip(ring, ring[1:]))
        elif name in rooms and name not in done:
            path.append(name)
            for other in sorted(rooms[name].included):
                yield from visit(other)
            path.pop()
            done.add(name)

    for name in sorted(rooms):
        yield from visit(name)


def types_of_one_name(root):
    found = {}  # name: the files that define it
    for top in (*MAY_USE, "tests", "bench"):
        for path in sorted((root / top).rglob("*.[ch]pp")):
            spaces = []  # the namespaces we are in; "": one without a name
            for line in path.read_text().splitlines():
                if opened := NAMESPACE.match(line):
                    spaces.append(opened[1])
                elif spaces and re.match(r"} +// namespace", line):
                    spaces.pop()
                elif (match := TYPE.match(line)) and "" not in spaces:
                    name = "::".join([*spaces, match[1]])
                    found.setdefault(name, []).append(str(path.relative_to(root)))
    for name, files in sorted(found.items()):
        if len(files) > 1:
            yield f"{name}: defined in {', '.join(files)}: give one another name"


def folders_without_room(root, rooms):
    for top in MAY_USE:
        for folder in sorted({p.parent for p in (root / top).rglob("*.?pp")}):
            name = str(folder.relative_to(root))
            if name not in rooms:
                yield f"{name}: sources without a room: its CMakeLists.txt has no tether_add_room"


def main():
    here = pathlib.Path(__file__).resolve().parents[2]
    root = pathlib.Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else here
    cmakes = [c for top in MAY_USE for c in sorted((root / top).rglob("CMakeLists.txt")) if is_room(c)]
    rooms = {room.name: room for room in (Room(root, cmake) for cmake in cmakes)}
    found = [*folders_without_room(root, rooms), *undeclared_and_unused(rooms), *cycles(rooms),
             *arrows_back_up(rooms), *types_of_one_name(root)]
    print("\n".join(found) if found else f"{len(rooms)} rooms, as they say")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
