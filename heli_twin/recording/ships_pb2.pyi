from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable
from typing import ClassVar as _ClassVar, Optional as _Optional

DESCRIPTOR: _descriptor.FileDescriptor

class Path(_message.Message):
    __slots__ = ("start", "step", "knots")
    START_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    KNOTS_FIELD_NUMBER: _ClassVar[int]
    start: int
    step: int
    knots: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, start: _Optional[int] = ..., step: _Optional[int] = ..., knots: _Optional[_Iterable[float]] = ...) -> None: ...

class Turn(_message.Message):
    __slots__ = ("outcome", "reason", "is_stuck", "iterations", "sent", "received")
    OUTCOME_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    IS_STUCK_FIELD_NUMBER: _ClassVar[int]
    ITERATIONS_FIELD_NUMBER: _ClassVar[int]
    SENT_FIELD_NUMBER: _ClassVar[int]
    RECEIVED_FIELD_NUMBER: _ClassVar[int]
    outcome: str
    reason: str
    is_stuck: bool
    iterations: int
    sent: int
    received: int
    def __init__(self, outcome: _Optional[str] = ..., reason: _Optional[str] = ..., is_stuck: bool = ..., iterations: _Optional[int] = ..., sent: _Optional[int] = ..., received: _Optional[int] = ...) -> None: ...

class PlanningTime(_message.Message):
    __slots__ = ("turn_ns", "solve_ns")
    TURN_NS_FIELD_NUMBER: _ClassVar[int]
    SOLVE_NS_FIELD_NUMBER: _ClassVar[int]
    turn_ns: int
    solve_ns: int
    def __init__(self, turn_ns: _Optional[int] = ..., solve_ns: _Optional[int] = ...) -> None: ...
