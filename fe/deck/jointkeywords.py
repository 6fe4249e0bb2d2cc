"""Keywords that join nodes: *TIE, *EQUATION, *MPC, *RIGID BODY, *COUPLING, *KINEMATIC COUPLING.

A rigid joint is read where its reference node does not turn: then the nodes move as that one does.
"""

from fe.case import Equation
from fe.deck import setnames
from fe.deck.draft import Draft
from fe.deck.joints import Rigid, TieDraft
from fe.deck.keywords import Keyword, Place, filled

ALL = (0, 1, 2)


def tie(draft: Draft, k: Keyword) -> None:
    """*TIE: slave and master surface."""
    k.only("NAME", "POSITION TOLERANCE", "ADJUST", "TYPE", "CONSTRAINT RATIO", "NO ROTATION", "NO THICKNESS")
    tolerance = None
    if k.parameters.get("POSITION TOLERANCE"):
        (tolerance,) = k.numbers(k.place, [k.parameters["POSITION TOLERANCE"]])
    for line, words in k.data:
        for word in words[:2]:
            setnames.known(k, draft.mesh.surfaces, word, line)
        slave, master = (str(setnames.key(draft.mesh.surfaces, w)) for w in words[:2])
        draft.ties.append(TieDraft(slave, master, tolerance, line))


def equation(draft: Draft, k: Keyword) -> None:
    """*EQUATION: how many terms, then node or set, component, factor of each."""
    lines = iter(k.data)
    for line, words in lines:
        count, rows = k.whole(line, words[0], low=2, high=1000), list[tuple[Place, list[str]]]()
        while len(rows) < count:
            place, row = next(lines, (line, []))
            if not row:
                raise IndexError
            rows += [(place, row[i : i + 3]) for i in range(0, len(row), 3)]
        terms = [_term(draft, k, place, row) for place, row in rows]
        size = max(len(labels) for labels, _, _ in terms)
        if any(len(labels) not in (1, size) for labels, _, _ in terms):
            raise k.error("*EQUATION with sets of different sizes: wanted one size, or single nodes", line)
        for i in range(size):
            row_terms = [(labels[i % len(labels)], d, f) for labels, d, f in terms]
            draft.equations.append(Equation(tuple(row_terms)))


def _term(draft: Draft, k: Keyword, line: Place, row: list[str]) -> tuple[list[int], int, float]:
    chosen = setnames.members(draft, k, draft.mesh.node_sets, row[0], line)
    component, factor = k.whole(line, row[1], low=1, high=3), k.numbers(line, filled(row[2:], ""))[0]
    if not factor or not chosen:
        raise k.error("*EQUATION with the factor 0, or an empty set: wanted factors that are not 0", line)
    return sorted(chosen), component - 1, factor


def mpc(draft: Draft, k: Keyword) -> None:
    """*MPC of the types TIE, PIN and BEAM: nodes or sets, the first of which follow the second."""
    for line, words in k.data:
        kind = words[0].upper()
        if kind not in ("TIE", "PIN", "BEAM"):
            raise k.error(f"*MPC {kind}: wanted TIE, PIN or BEAM; write *EQUATION for others", line)
        followers, masters = (
            setnames.members(draft, k, draft.mesh.node_sets, word, line) for word in filled(words[1:], "", "")
        )
        if len(masters) not in (1, len(followers)):
            raise k.error(
                f"*MPC between {len(followers)} and {len(masters)} nodes: wanted one node, or as many", line
            )
        if kind == "BEAM":
            for master in masters[: 1 if len(masters) == 1 else None]:
                nodes = followers if len(masters) == 1 else [followers[masters.index(master)]]
                draft.rigid.append(Rigid(master, list(nodes), ALL, line, k.name))
            continue
        pairs = zip(followers, masters if len(masters) > 1 else masters * len(followers), strict=True)
        draft.equations += [Equation(((a, d, 1.0), (b, d, -1.0))) for a, b in pairs for d in ALL]


def rigid_body(draft: Draft, k: Keyword) -> None:
    """*RIGID BODY of elements or nodes with a reference node."""
    nodes: list[int] = []
    if "ELSET" in k.parameters:
        chosen = setnames.known(k, draft.mesh.element_sets, k.text("ELSET"), k.place)
        nodes += sorted({n for e in chosen for n in draft.mesh.element(e)[1]})
    for name in ("NSET", "TIE NSET", "PIN NSET"):
        if name in k.parameters:
            nodes.extend(setnames.known(k, draft.mesh.node_sets, k.text(name), k.place))
    if not nodes:
        raise k.error("*RIGID BODY: wanted ELSET=, TIE NSET= or PIN NSET= of its elements or nodes")
    draft.rigid.append(Rigid(_reference(draft, k), nodes, ALL, k.place, k.name))


def _reference(draft: Draft, k: Keyword) -> int:
    word = k.text("REF NODE")
    chosen = setnames.members(draft, k, draft.mesh.node_sets, word, k.place)
    if len(chosen) != 1:
        raise k.error(f"*{k.name}, REF NODE={word}: {len(chosen)} nodes; wanted one")
    return chosen[0]


def coupling(draft: Draft, k: Keyword) -> None:
    """*COUPLING: the nodes of a surface, and the reference node that *KINEMATIC below ties them to."""
    name = setnames.key(draft.mesh.surfaces, k.text("SURFACE"))
    if name is None:
        setnames.known(k, draft.mesh.surfaces, k.text("SURFACE"), k.place)
    nodes = draft.mesh.nodes_on(draft.mesh.surfaces[str(name)])
    draft.coupled = Rigid(_reference(draft, k), nodes, ALL, k.place, k.name)


def kinematic(draft: Draft, k: Keyword) -> None:
    """*KINEMATIC, below *COUPLING: the components, by default all."""
    if draft.coupled is None:
        raise k.error("*KINEMATIC without *COUPLING above: wanted it below that; move it")
    joint, draft.coupled = draft.coupled, None
    draft.rigid.append(joint.only(_components(k, 0)))


def kinematic_coupling(draft: Draft, k: Keyword) -> None:
    """*KINEMATIC COUPLING: nodes or sets, first and last component, of a reference node."""
    reference = _reference(draft, k)
    for line, words in k.data:
        nodes = setnames.members(draft, k, draft.mesh.node_sets, words[0], line)
        joint = Rigid(reference, list(nodes), ALL, line, k.name)
        row = Keyword(k.name, {}, [(line, words)], line)
        draft.rigid.append(joint.only(_components(row, 1)))


def _components(k: Keyword, start: int) -> tuple[int, ...]:
    """The components that data lines name, by default 0, 1, 2."""
    components: set[int] = set()
    for line, words in k.data:
        first, last = filled(words[start:], "", "")
        if first or last:
            low = k.whole(line, first, low=1, high=6)
            high = k.whole(line, last or first, low=low, high=6)
            components |= set(range(low - 1, high))
    return tuple(sorted(components & {0, 1, 2})) if components else ALL


