"""Rows of trials -> rates with Wilson intervals, power curves, and the confusion by class."""

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from twin.diagnosis.grades import Grade
from twin.effects.labels import AND, KINDS, name_of
from twin.effects.library import all_effects

Row = dict[str, Any]
CLEAR = 8.0  # non-centrality from which on an effect ought to be named
BINS = (0.0, 4.0, 8.0, 15.0, 40.0, np.inf)  # non-centralities of the power curve
SAID = ("fresh same", "fresh other", "later")  # groups that how sure a name is rests on
SAMPLE = 60  # trials of a table that say what their verdict was
VERDICT = ("verdict", "nearest", "grade", "mechanisms")  # of a row, as a test compares them
QUANTITIES = ("sum", "share", "size")  # whose 95 % intervals are asked for the truth
GATED = ("zoomed",)  # unknown kinds that the test of the frame catches


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


def verdict_of(row: Row) -> list[set[str]]:
    """What a verdict names: sets that these data cannot tell apart, each of names missing together."""
    tied = [name for tie in row.get("ties", ()) for name in tie] or [AND.join(row.get("named", ()))]
    return [{name_of(part) for part in group.split(AND)} for group in tied if group]


def named(row: Row) -> set[str]:
    """All names in a verdict, a kind of stand-in being one."""
    return {name for group in verdict_of(row) for name in group}


def first(row: Row) -> bool:
    """Whether what is named first is hidden."""
    return bool(row["names"]) and name_of(row["names"][0].partition(AND)[0]) in row["physics"]


def in_set(row: Row) -> bool:
    """Whether all that is hidden is among what the verdict names; a kind of stand-in that is named as one of
    `A or B` names the effects that it says in general."""
    same = {e.name: KINDS[e.generic] for e in all_effects() if e.generic}
    said = {words: [name for name, own in same.items() if own == words] for words in KINDS.values()}
    names = {n for name in named(row) for n in (name, *said.get(name, ()))}
    return bool(row["physics"]) and set(row["physics"]) <= names


def set_size(row: Row) -> int:
    """How many names stand in a verdict, a kind of stand-in being one."""
    return len(named(row))


def wrong_alone(row: Row) -> bool:
    """Whether every alternative that a verdict names holds an effect that is not hidden, and no kind of
    stand-in is one of them."""
    told = verdict_of(row)
    words = set(KINDS.values())
    return bool(told) and all(names - set(row["physics"]) and not names & words for names in told)


def alone(row: Row) -> bool:
    """Whether what is hidden is named and nothing else."""
    return named(row) == set(row["physics"])


def exact(row: Row) -> bool:
    """Whether a verdict on a pair names both effects and no other: alone, or as one of several pairs that
    these data cannot tell apart."""
    told = verdict_of(row)
    return set(row["physics"]) in told and {len(names) for names in told} == {2}


def top1(row: Row) -> bool:
    """Whether it is named first; of one ramp of one marker, where everything is a tie, alone."""
    return alone(row) if row.get("protocol") == "P1" else first(row)


def spurious(row: Row) -> bool:
    """Whether a second effect is named where one is hidden."""
    return any(len(names) > 1 for names in verdict_of(row))


def flagged(row: Row) -> bool:
    """Whether an unknown kind is not called by a wrong name alone: none of the library's, or a class with a
    stand-in for what is outside. `none needed` is neither."""
    verdict = row["verdict"]
    outside = "none of these" in verdict or "cannot test" in verdict or verdict.startswith("weak")
    return outside or any(names & set(KINDS.values()) for names in verdict_of(row))


def unseen(row: Row) -> bool:
    """Whether the verdict is that nothing is needed."""
    return "none needed" in row["verdict"]


def reached(row: Row) -> float:
    """The smallest non-centrality of what is hidden, of several that of each beside the others."""
    return min((h.get("beside", h["sigmas"]) for h in row["hidden"]), default=0.0)


def clear(rows: Sequence[Row]) -> list[Row]:
    """The rows whose hidden effects ought to be named."""
    return [r for r in rows if reached(r) >= CLEAR]


# -- tables --------------------------------------------------------------------------------------------------


def scores(rows: Sequence[Row]) -> Row:
    """Of clear rows: n, shares with the interval of each, and the mean size of the verdicts that name
    something."""
    out: Row = {"n": len(rows)}
    for score in (first, in_set, wrong_alone):
        hits = [score(r) for r in rows]
        out |= {score.__name__: _share(hits), f"{score.__name__}_interval": wilson(sum(hits), len(hits))}
    return out | {"set_size": sizes(rows)}


def sizes(rows: Sequence[Row]) -> float | None:
    """The mean size of the verdicts that name something."""
    return _mean([set_size(r) for r in rows if r["names"]])


def group(rows: Sequence[Row]) -> Row:
    """One cell of the table: trials of one protocol and law."""
    own = clear(rows)
    right = [r for r in own if in_set(r)]
    hits = [top1(r) for r in own]
    ratio = [r["rms_over_sd"] for r in right if r.get("rms_over_sd")]
    inside = [v for r in right if r.get("adequate") for v in r.get("inside", {}).values()]
    gains = [r["base_heldout"] / r["heldout"] for r in right if r.get("heldout") and r.get("base_heldout")]
    return scores(own) | {
        "in_nearest": _share(map(in_nearest, own)),
        "named": _share(map(is_named, own)),
        "top1": _share(hits),
        "top1_interval": wilson(sum(hits), len(hits)),
        "tie": _share(in_set(r) and not alone(r) for r in own),
        "spurious_second": _share(map(spurious, own)),
        "rms_over_sd": _median(ratio),
        "coverage": _share(inside),
        "coverage_n": len(inside),
        "heldout_ratio": _median(gains),
        "too_faint": len(rows) - len(own),
    }


def unknowns(rows: Sequence[Row]) -> Row:
    """Of clear trials of what no library holds: how many are flagged, how many misnamed, and how many are
    neither, being called none needed."""
    own = clear(rows)
    hits, wrong = [flagged(r) for r in own], [not flagged(r) and not unseen(r) for r in own]
    return {
        "n": len(own), "flagged": _share(hits), "interval": wilson(sum(hits), len(own)),
        "misnamed": _share(wrong), "misnamed_interval": wilson(sum(wrong), len(own)),
        "none_needed": sum(map(unseen, own)), "too_faint": len(rows) - len(own),
        "by_kind": {k: rate([flagged(r) for r in own if r["kinds"] == [k]])
                    for k in sorted({r["kinds"][0] for r in own})},
    }  # fmt: skip


def without_gate(rows: Sequence[Row]) -> list[Row]:
    """The rows but for those whose kind the test of the frame catches before any diagnosis."""
    return [r for r in rows if not set(r["kinds"]) & set(GATED)]


def unknown_table(rows: Sequence[Row]) -> Row:
    """Unknown kinds, and the same without those that the frame's test catches."""
    apart = {k: v for k, v in unknowns(without_gate(rows)).items() if k != "by_kind"}
    return unknowns(rows) | {"without_zoomed": apart}


def pairs(rows: Sequence[Row]) -> Row:
    """Two effects at once, each clear beside the other."""
    own = clear(rows)
    right = [exact(r) for r in own]
    return scores(own) | {
        "exact": _share(right),
        "interval": wilson(sum(right), len(right)),
        "alone": _share(map(alone, own)),
        "one_in_set": _share(bool(set(r["physics"]) & named(r)) for r in own),
        "too_faint": len(rows) - len(own),
    }


def of_laws(rows: Sequence[Row]) -> Row:
    """Kinds of several laws in one group: the scores of those of the library, and the unknown ones."""
    known = [r for r in rows if all(r["physics"])]
    return {"known": scores(clear(known)), "unknown": unknowns([r for r in rows if r not in known])}


def nearest(row: Row) -> list[set[str]]:
    """The sets of names that come nearest, whether a verdict names them or not."""
    return [{name_of(part) for part in group.split(AND)} for group in row.get("nearest", ())]


def in_nearest(row: Row) -> bool:
    """Whether all that is hidden is among what comes nearest."""
    return bool(row["physics"]) and set(row["physics"]) <= {n for names in nearest(row) for n in names}


def name_right(row: Row) -> bool:
    """Whether what comes first is hidden, and nothing else."""
    return nearest(row)[:1] == [set(row["physics"])]


def mechanism_right(row: Row) -> bool:
    """Whether the mechanism of what comes first is one of what is hidden."""
    return bool(row.get("mechanisms")) and row["mechanisms"][0] in row["hidden_mechanisms"]


def said(rows: Sequence[Row]) -> Row:
    """By grade, of clear trials that state their mechanism: n, how often the first name was right, and the
    mechanism."""
    own = [r for r in clear(rows) if r.get("hidden_mechanisms")]
    of = {grade: [r for r in own if r.get("grade") == grade] for grade in Grade}
    return {
        grade: {"name": rate([*map(name_right, rs)]), "mechanism": rate([*map(mechanism_right, rs)])}
        for grade, rs in of.items()
    }


def strangers(rows: Sequence[Row]) -> Row:
    """The clear trials of kinds of the folder: the nearest names of those that the library has, and the
    grades that the others reach; each share with its interval."""
    own = clear(rows)
    have, lack = [r for r in own if all(r["physics"])], [r for r in own if not all(r["physics"])]
    return {
        "known": shares(have, in_nearest=in_nearest, wrong_alone=wrong_alone, named=is_named),
        "unknown": shares(lack, named=is_named, likely=is_likely, mechanism=mechanism_right),
    }


def shares(rows: Sequence[Row], **scores: Callable[[Row], bool]) -> Row:
    """n, and of every score the share of the rows that have it, with its interval."""
    out: Row = {"n": len(rows)}
    for name, score in scores.items():
        found = rate([score(r) for r in rows])
        out |= {name: found["rate"], f"{name}_interval": found["interval"]}
    return out


def is_named(row: Row) -> bool:
    """Whether the verdict is of the surest grade."""
    return row.get("grade") == Grade.NAMED


def is_likely(row: Row) -> bool:
    """Whether the verdict is of the grade whose names are told as right in 9 of 10."""
    return row.get("grade") == Grade.LIKELY


def over_floor(rows: Sequence[Row]) -> Row:
    """Over clear and rightly named trials, the median of the error in the unseen orientation over the same
    draw's with nothing hidden."""
    right = [r for r in clear(rows) if in_set(r) and r.get("heldout") and r.get("floor")]
    return {"n": len(right), "median": _median([r["heldout"] / r["floor"] for r in right])}


def power(rows: Sequence[Row]) -> Row:
    """The share that is named first or in the reported set by the non-centrality that is reached."""
    out = {}
    for low, high in pairwise(BINS):
        own = [r for r in rows if low <= reached(r) < high]
        name = f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} on"
        if own:
            out[name] = {
                "n": len(own), "first": _share(map(first, own)), "top1": _share(map(top1, own)),
                "in_set": _share(map(in_set, own)), "set_size": sizes(own),
                "none_needed": _share(map(unseen, own)),
            }  # fmt: skip
    return out


def confusion(rows: Sequence[Row]) -> Row:
    """By what is hidden, how often which verdict was given."""
    out: dict[str, Counter[str]] = {}
    for r in rows:
        out.setdefault("+".join(r["kinds"]), Counter())[r["verdict"].partition(":")[0]] += 1
    return {k: dict(c.most_common()) for k, c in sorted(out.items())}


def sample(rows: Sequence[Row], count: int = SAMPLE) -> list[Row]:
    """Of so many trials, evenly spread, what names them, and what the verdict was: a test runs them again."""
    own = [r for r in rows if not r.get("failed") and not r["group"].startswith("bodies")]
    at = np.unique(np.linspace(0, len(own) - 1, count).round().astype(int)) if own else ()
    return [{key: own[k].get(key) for key in ("key", "without", "commit", *VERDICT)} for k in at]


def summary(rows: Sequence[Row]) -> Row:
    """The whole table of the trials that `identify.py` runs."""
    of: dict[str, list[Row]] = {}
    for r in rows:
        of.setdefault(r["group"], []).append(r)
    table: Row = {}
    for protocol in ("P5", "P3", "P1"):
        table[protocol] = {law: group(of.get(f"{protocol} {law}", [])) for law in ("same", "other")}
    quiet = {name: of.get(name, []) for name in ("white", "ar1")}
    alarms = {name: [not unseen(r) for r in own] for name, own in quiet.items()}
    both = rate([alarm for own in alarms.values() for alarm in own])
    table["false_alarm"] = both | {name: rate(own) for name, own in alarms.items()}
    table["unknown"] = unknown_table(of.get("unknown", []))
    table["left_out"] = unknown_table(of.get("left out", []))
    single = {law: [*of.get(f"P5 {law}", []), *of.get(f"fresh {law}", [])] for law in ("same", "other")}
    known = [r for r in [*single["same"], *single["other"], *of.get("later", [])] if all(r["physics"])]
    second = shares(clear(known), spurious=spurious)
    second["spurious_n"] = second.pop("n")
    table["pairs"] = pairs(of.get("pairs", [])) | second
    table["fresh"] = {
        "same": group(of.get("fresh same", [])), "other": group(of.get("fresh other", [])),
        "unknown": unknown_table(of.get("fresh unknown", [])), "pairs": pairs(of.get("fresh pairs", [])),
    }  # fmt: skip
    table["kinds_after_freeze"] = of_laws(of.get("later", [])) | {
        "left_out": unknowns(of.get("later left out", []))
    }
    table["strangers"] = strangers(of.get("later", []))
    table["said"] = said([r for name in SAID for r in of.get(name, [])])
    table["said_9_of_10"] = table["said"][Grade.LIKELY]["name"]
    table["heldout_over_floor"] = {law: over_floor(own) for law, own in single.items()}
    table["coverage"] = {protocol: covered(rows, protocol) for protocol in ("P1", "P3", "P5")}
    table["coverage"] |= {law: covered_by(own) for law, own in single.items()}
    table["bodies"] = bodies([r for r in rows if r["group"].startswith("bodies")])
    table["coverage_nothing_hidden"] = _share(
        v for own in quiet.values() for r in own for v in r.get("inside", {}).values()
    )
    table["power"] = {k: power(own) for k, own in sorted(of.items()) if k[0] == "P" and " " in k}
    table["confusion"] = {k: confusion(own) for k, own in sorted(of.items())}
    seconds = [r["seconds"] for r in rows if "seconds" in r]
    table["seconds"] = {"diagnose_all": _median(seconds), "total": float(np.sum(seconds)) if seconds else 0.0}
    table["solves"] = {"median": _median([r["solves"] for r in rows if "solves" in r])}
    table["sample"] = sample(rows)
    table["trials"], table["failed"] = len(rows), sum(bool(r.get("failed")) for r in rows)
    return table


def covered(rows: Sequence[Row], protocol: str) -> Row:
    """How often 95 % intervals of rightly named, adequate fits hold the truth."""
    single = [r for r in clear(rows) if r["protocol"] == protocol and len(r["kinds"]) == 1]
    own = [r for r in single if r["physics"][0] and in_set(r) and r.get("adequate")]
    return rate([v for r in own for v in r.get("inside", {}).values()])


def covered_by(rows: Sequence[Row]) -> Row:
    """The same of trials of one law, of each quantity: the sum and the share of the constants, and sizes; n
    of each."""
    own = [r for r in clear(rows) if in_set(r) and r.get("adequate")]
    found = {key: [r["inside"][key] for r in own if key in r.get("inside", {})] for key in QUANTITIES}
    count = {key: len(hits) for key, hits in found.items()}
    return {key: _share(hits) for key, hits in found.items()} | {"n": count}


def bodies(rows: Sequence[Row]) -> Row:
    """Of clear films of other bodies: n, how many have a wrong name alone, and the share whose nearest set
    holds what is hidden."""
    own = clear(rows)
    return {"n": len(own), "wrong": sum(map(wrong_alone, own)), "in_nearest": _share(map(in_nearest, own)),
            "too_faint": len(rows) - len(own)}  # fmt: skip


def _share(flags: Any) -> float | None:
    return _mean([float(flag) for flag in flags])


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if len(values) else None


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if len(values) else None
