from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class QpStatus(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    QP_STATUS_UNSPECIFIED: _ClassVar[QpStatus]
    QP_STATUS_SOLVED: _ClassVar[QpStatus]
    QP_STATUS_SOFTENED: _ClassVar[QpStatus]
    QP_STATUS_SHIFTED_PLAN: _ClassVar[QpStatus]
    QP_STATUS_SAFE_HOVER: _ClassVar[QpStatus]
QP_STATUS_UNSPECIFIED: QpStatus
QP_STATUS_SOLVED: QpStatus
QP_STATUS_SOFTENED: QpStatus
QP_STATUS_SHIFTED_PLAN: QpStatus
QP_STATUS_SAFE_HOVER: QpStatus

class Truth(_message.Message):
    __slots__ = ("stamp", "position", "quat_wxyz", "velocity", "angular_velocity", "yaw", "yaw_rate", "actuators", "touching")
    STAMP_FIELD_NUMBER: _ClassVar[int]
    POSITION_FIELD_NUMBER: _ClassVar[int]
    QUAT_WXYZ_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_FIELD_NUMBER: _ClassVar[int]
    ANGULAR_VELOCITY_FIELD_NUMBER: _ClassVar[int]
    YAW_FIELD_NUMBER: _ClassVar[int]
    YAW_RATE_FIELD_NUMBER: _ClassVar[int]
    ACTUATORS_FIELD_NUMBER: _ClassVar[int]
    TOUCHING_FIELD_NUMBER: _ClassVar[int]
    stamp: int
    position: _containers.RepeatedScalarFieldContainer[float]
    quat_wxyz: _containers.RepeatedScalarFieldContainer[float]
    velocity: _containers.RepeatedScalarFieldContainer[float]
    angular_velocity: _containers.RepeatedScalarFieldContainer[float]
    yaw: float
    yaw_rate: float
    actuators: _containers.RepeatedScalarFieldContainer[float]
    touching: bool
    def __init__(self, stamp: _Optional[int] = ..., position: _Optional[_Iterable[float]] = ..., quat_wxyz: _Optional[_Iterable[float]] = ..., velocity: _Optional[_Iterable[float]] = ..., angular_velocity: _Optional[_Iterable[float]] = ..., yaw: _Optional[float] = ..., yaw_rate: _Optional[float] = ..., actuators: _Optional[_Iterable[float]] = ..., touching: bool = ...) -> None: ...

class Pose(_message.Message):
    __slots__ = ("stamp", "position", "quat_wxyz")
    STAMP_FIELD_NUMBER: _ClassVar[int]
    POSITION_FIELD_NUMBER: _ClassVar[int]
    QUAT_WXYZ_FIELD_NUMBER: _ClassVar[int]
    stamp: int
    position: _containers.RepeatedScalarFieldContainer[float]
    quat_wxyz: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, stamp: _Optional[int] = ..., position: _Optional[_Iterable[float]] = ..., quat_wxyz: _Optional[_Iterable[float]] = ...) -> None: ...

class Estimate(_message.Message):
    __slots__ = ("stamp", "x", "disturbance", "variance", "pose_stamp", "rejected")
    STAMP_FIELD_NUMBER: _ClassVar[int]
    X_FIELD_NUMBER: _ClassVar[int]
    DISTURBANCE_FIELD_NUMBER: _ClassVar[int]
    VARIANCE_FIELD_NUMBER: _ClassVar[int]
    POSE_STAMP_FIELD_NUMBER: _ClassVar[int]
    REJECTED_FIELD_NUMBER: _ClassVar[int]
    stamp: int
    x: _containers.RepeatedScalarFieldContainer[float]
    disturbance: _containers.RepeatedScalarFieldContainer[float]
    variance: _containers.RepeatedScalarFieldContainer[float]
    pose_stamp: int
    rejected: int
    def __init__(self, stamp: _Optional[int] = ..., x: _Optional[_Iterable[float]] = ..., disturbance: _Optional[_Iterable[float]] = ..., variance: _Optional[_Iterable[float]] = ..., pose_stamp: _Optional[int] = ..., rejected: _Optional[int] = ...) -> None: ...

class Reference(_message.Message):
    __slots__ = ("stamp", "x", "u")
    STAMP_FIELD_NUMBER: _ClassVar[int]
    X_FIELD_NUMBER: _ClassVar[int]
    U_FIELD_NUMBER: _ClassVar[int]
    stamp: int
    x: _containers.RepeatedScalarFieldContainer[float]
    u: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, stamp: _Optional[int] = ..., x: _Optional[_Iterable[float]] = ..., u: _Optional[_Iterable[float]] = ...) -> None: ...

class Command(_message.Message):
    __slots__ = ("stamp", "u")
    STAMP_FIELD_NUMBER: _ClassVar[int]
    U_FIELD_NUMBER: _ClassVar[int]
    stamp: int
    u: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, stamp: _Optional[int] = ..., u: _Optional[_Iterable[float]] = ...) -> None: ...

class Plan(_message.Message):
    __slots__ = ("x", "u", "u_nominal")
    X_FIELD_NUMBER: _ClassVar[int]
    U_FIELD_NUMBER: _ClassVar[int]
    U_NOMINAL_FIELD_NUMBER: _ClassVar[int]
    x: _containers.RepeatedScalarFieldContainer[float]
    u: _containers.RepeatedScalarFieldContainer[float]
    u_nominal: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, x: _Optional[_Iterable[float]] = ..., u: _Optional[_Iterable[float]] = ..., u_nominal: _Optional[_Iterable[float]] = ...) -> None: ...

class QpReport(_message.Message):
    __slots__ = ("status", "iterations", "active_bounds", "objective", "slack")
    STATUS_FIELD_NUMBER: _ClassVar[int]
    ITERATIONS_FIELD_NUMBER: _ClassVar[int]
    ACTIVE_BOUNDS_FIELD_NUMBER: _ClassVar[int]
    OBJECTIVE_FIELD_NUMBER: _ClassVar[int]
    SLACK_FIELD_NUMBER: _ClassVar[int]
    status: QpStatus
    iterations: int
    active_bounds: int
    objective: float
    slack: float
    def __init__(self, status: _Optional[_Union[QpStatus, str]] = ..., iterations: _Optional[int] = ..., active_bounds: _Optional[int] = ..., objective: _Optional[float] = ..., slack: _Optional[float] = ...) -> None: ...

class Air(_message.Message):
    __slots__ = ("wind", "acceleration", "thrust_factor")
    WIND_FIELD_NUMBER: _ClassVar[int]
    ACCELERATION_FIELD_NUMBER: _ClassVar[int]
    THRUST_FACTOR_FIELD_NUMBER: _ClassVar[int]
    wind: _containers.RepeatedScalarFieldContainer[float]
    acceleration: _containers.RepeatedScalarFieldContainer[float]
    thrust_factor: float
    def __init__(self, wind: _Optional[_Iterable[float]] = ..., acceleration: _Optional[_Iterable[float]] = ..., thrust_factor: _Optional[float] = ...) -> None: ...

class Battery(_message.Message):
    __slots__ = ("voltage", "current", "charge")
    VOLTAGE_FIELD_NUMBER: _ClassVar[int]
    CURRENT_FIELD_NUMBER: _ClassVar[int]
    CHARGE_FIELD_NUMBER: _ClassVar[int]
    voltage: float
    current: float
    charge: float
    def __init__(self, voltage: _Optional[float] = ..., current: _Optional[float] = ..., charge: _Optional[float] = ...) -> None: ...

class Timing(_message.Message):
    __slots__ = ("control_step_ns", "solve_ns")
    CONTROL_STEP_NS_FIELD_NUMBER: _ClassVar[int]
    SOLVE_NS_FIELD_NUMBER: _ClassVar[int]
    control_step_ns: int
    solve_ns: int
    def __init__(self, control_step_ns: _Optional[int] = ..., solve_ns: _Optional[int] = ...) -> None: ...

class ExtraEstimate(_message.Message):
    __slots__ = ("stamp", "x", "variance")
    STAMP_FIELD_NUMBER: _ClassVar[int]
    X_FIELD_NUMBER: _ClassVar[int]
    VARIANCE_FIELD_NUMBER: _ClassVar[int]
    stamp: int
    x: _containers.RepeatedScalarFieldContainer[float]
    variance: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, stamp: _Optional[int] = ..., x: _Optional[_Iterable[float]] = ..., variance: _Optional[_Iterable[float]] = ...) -> None: ...

class ExtraPlan(_message.Message):
    __slots__ = ("x",)
    X_FIELD_NUMBER: _ClassVar[int]
    x: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, x: _Optional[_Iterable[float]] = ...) -> None: ...

class Moment(_message.Message):
    __slots__ = ("moment",)
    MOMENT_FIELD_NUMBER: _ClassVar[int]
    moment: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, moment: _Optional[_Iterable[float]] = ...) -> None: ...
