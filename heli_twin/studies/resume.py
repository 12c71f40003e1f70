"""Resuming a study whose code has changed: rows of other code are kept or flown again, but only when told so."""

from collections import Counter

from heli_twin.studies.errors import StudyError
from heli_twin.studies.flight_code import changes_of, code_parts, file_hash
from heli_twin.studies.plan import StudyPlan
from heli_twin.studies.store import Store


def check_code(plan: StudyPlan, store: Store, code: str, *, again: bool, accept_old: bool) -> None:
    """Refuse to mix rows of other code with those of this code, and keep the parts that this code is made of.

    Args:
        plan: The study.
        store: Its rows of earlier launches.
        code: The hash of this code.
        again: Forget all rows of other code.
        accept_old: Keep them.

    Raises:
        StudyError: Other code flew some of the wanted runs; the message names the changed parts.
    """
    other = store.flown_by_other(code)
    if again and not accept_old:
        store.forget(other)
    elif other and not accept_old:
        # An adaptive design begins with the same batch every time.
        codes = Counter(other[run.id] for run in plan.runs(next(plan.batches())) if run.id in other)
        if codes:
            before = store.parts_of(codes.most_common(1)[0][0])
            changed = f"changed since: {changes_of(before, code_parts())}" if before else "it left no hash"
            raise StudyError(
                f"{codes.total()} flights in {store.path.parent} were flown by other code ({changed}) and would be"
                " flown again: say --again to do so, or --accept-old to keep them"
            )
    if store.code_of(file_hash()) is None:
        store.keep_code(code, file_hash(), code_parts())
