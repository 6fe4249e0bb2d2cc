"""Rows of trials -> rates with Wilson intervals, power curves, the confusion by class, and simpler rules
beside."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from twin.effects.labels import AND, KINDS, OR
from twin.effects.library import all_effects

Row = dict[str, Any]
CLEAR = 8.0  # non-centrality from which on an effect ought to be named


def wilson(hits: int, n: int) -> list[float]:
    """The 95 % interval of a rate (Wilson 1927, doi 10.1080/01621459.1927.10502953)."""
    if not n:
        return [0.0, 1.0]
    z, p = 1.96, hits / n
    middle, half = p + z**2 / (2 * n), z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    return [round(float((middle + s * half) / (1 + z**2 / n)), 4) for s in (-1, 1)]


def rate(flags: Sequence[bool]) -> dict[str, Any]:
    """n, the rate, and its interval."""
    n, hits = len(flags), int(sum(flags))
    return {"n": n, "rate": hits / n if n else None, "interval": wilson(hits, n)}


# -- what counts as right -----------------------------------------------------------------------------------


def in_set(row: Row) -> bool:
    """Whether what is hidden is among what the verdict names; a kind of stand-in that is named as one of
    `A or B` names the effects that it says in general."""
    same = {e.name: KINDS[e.generic] for e in all_effects() if e.generic}
    said = {words: [name for name, own in same.items() if own == words] for words in KINDS.values()}
    names = {n for name in row["names"] for n in (name, *said.get(name, ()))}
    return bool(set(row["physics"]) <= names)


def exact(row: Row) -> bool:
    """Whether a verdict on a pair names both effects and no other: alone, or as one of several pairs that
    these data cannot tell apart."""
    told = [set(name.split(AND)) for name in row["verdict"].partition(":")[0].split(OR)]
    return set(row["physics"]) in told and {len(names) for names in told} == {2}


def top1(row: Row) -> bool:
    """Whether it is named first, or with the class that it belongs to."""
    names = row["names"]
    return bool(names) and in_set(row) and (names[0] in row["physics"] or not joined(row))


def joined(row: Row) -> bool:
    """Whether a verdict names several effects together."""
    return " + " in row["verdict"].partition(":")[0]


def spurious(row: Row) -> bool:
    """Whether a second effect is named where one is hidden."""
    return joined(row)


def flagged(row: Row) -> bool:
    """Whether an unknown kind is not called by a wrong name alone: none of the library's, or a class with a
    stand-in for what is outside."""
    verdict = row["verdict"]
    outside = "none of these" in verdict or "cannot test" in verdict or verdict.startswith("weak")
    return outside or "none needed" in verdict or " or an " in verdict or " or a " in verdict


# -- tables --------------------------------------------------------------------------------------------------


def group(rows: Sequence[Row]) -> Row:
    """One cell of the table: trials of one protocol and law."""
    clear = [r for r in rows if all(h["sigmas"] >= CLEAR for h in r["hidden"])]
    right = [r for r in clear if top1(r)]
    ratio = [r["rms_over_sd"] for r in right if r.get("rms_over_sd")]
    inside = [v for r in right if r.get("adequate") for v in r.get("inside", {}).values()]
    gains = [r["base_heldout"] / r["heldout"] for r in right if r.get("heldout") and r.get("base_heldout")]
    return {
        "n": len(clear),
        "top1": _share(map(top1, clear)),
        "top1_interval": wilson(sum(map(top1, clear)), len(clear)),
        "in_set": _share(map(in_set, clear)),
        "in_set_interval": wilson(sum(map(in_set, clear)), len(clear)),
        "spurious_second": _share(map(spurious, clear)),
        "rms_over_sd": _median(ratio),
        "coverage": _share(inside),
        "coverage_n": len(inside),
        "heldout_ratio": _median(gains),
        "too_faint": len(rows) - len(clear),
    }


def power(rows: Sequence[Row]) -> Row:
    """The share that is named or in the reported set by the non-centrality asked for."""
    out = {}
    for size in sorted({r["wanted"] for r in rows}):
        own = [r for r in rows if r["wanted"] == size]
        out[f"{size:g}"] = {
            "n": len(own), "top1": _share(map(top1, own)), "in_set": _share(map(in_set, own)),
            "none_needed": _share("none needed" in r["verdict"] for r in own),
        }  # fmt: skip
    return out


def confusion(rows: Sequence[Row]) -> Row:
    """By what is hidden, how often which verdict was given."""
    out: dict[str, Counter[str]] = {}
    for r in rows:
        out.setdefault("+".join(r["kinds"]), Counter())[r["verdict"].partition(":")[0]] += 1
    return {k: dict(c.most_common()) for k, c in sorted(out.items())}


def baselines(rows: Sequence[Row]) -> Row:
    """What simpler rules would have said in the same trials."""
    rules = sorted({name for r in rows for name in r.get("baselines", {})})
    out: Row = {}
    for rule in rules:
        known = [
            r for r in rows if rule in r.get("baselines", {}) and len(r["physics"]) == 1 and r["physics"][0]
        ]
        known = [r for r in known if all(h["sigmas"] >= CLEAR for h in r["hidden"])]
        nothing = [r for r in rows if rule in r.get("baselines", {}) and not r["kinds"]]
        unknown = [r for r in rows if rule in r.get("baselines", {}) and r["group"] == "unknown"]
        out[rule] = {
            "top1": rate([r["baselines"][rule] == r["physics"][0] for r in known]),
            "false_alarm": rate([bool(r["baselines"][rule]) for r in nothing]),
            "unknown_not_named": rate([not r["baselines"][rule] for r in unknown]),
        }
    held = [
        r["ridge_heldout"] / r["base_heldout"]
        for r in rows
        if r.get("ridge_heldout") and r.get("base_heldout")
    ]
    out["ridge"] = {"heldout_over_base": _median(held), "n": len(held)}
    return out


def summary(rows: Sequence[Row]) -> Row:
    """The whole table."""
    of: dict[str, list[Row]] = {}
    for r in rows:
        of.setdefault(r["group"], []).append(r)
    table: Row = {}
    for protocol in ("P5", "P3", "P1"):
        table[protocol] = {law: group(of.get(f"{protocol} {law}", [])) for law in ("same", "other")}
    quiet = {name: of.get(name, []) for name in ("white", "ar1")}
    table["false_alarm"] = {
        name: rate(["none needed" not in r["verdict"] for r in own]) for name, own in quiet.items()
    }
    unknown = of.get("unknown", [])
    table["unknown"] = {"n": len(unknown), "flagged": _share(map(flagged, unknown)),
                        "interval": wilson(sum(map(flagged, unknown)), len(unknown)),
                        "by_kind": {k: rate([flagged(r) for r in unknown if r["kinds"] == [k]])
                                    for k in sorted({r["kinds"][0] for r in unknown})}}  # fmt: skip
    pairs = [r for r in of.get("pairs", []) if all(h["sigmas"] >= CLEAR for h in r["hidden"])]
    right = [exact(r) for r in pairs]
    table["pairs"] = {
        "n": len(pairs),
        "exact": _share(right),
        "interval": wilson(sum(right), len(right)),
        "alone": _share(set(r["named"]) == set(r["physics"]) and not r["ties"] for r in pairs),
        "one_in_set": _share(bool(set(r["physics"]) & set(r["names"])) for r in pairs),
    }
    for name in ("film", "full_fe"):
        own = of.get(name, [])
        key = "top1" if name == "film" else "agree"
        table[name] = {"n": len(own), key: _share(r[key] for r in own)}
    table["coverage_nothing_hidden"] = _share(
        v for own in quiet.values() for r in own for v in r.get("inside", {}).values()
    )
    table["power"] = {k: power(own) for k, own in sorted(of.items()) if k[0] == "P" and " " in k}
    table["confusion"] = {k: confusion(own) for k, own in sorted(of.items())}
    seconds = [r["seconds"] for r in rows if "seconds" in r]
    table["seconds"] = {"diagnose_all": _median(seconds), "total": float(np.sum(seconds)) if seconds else 0.0}
    table["solves"] = {"median": _median([r["solves"] for r in rows if "solves" in r])}
    table["baselines"] = baselines(rows)
    table["trials"] = len(rows)
    return table


def _share(flags: Any) -> float | None:
    own = list(flags)
    return float(np.mean(own)) if own else None


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if len(values) else None
