"""Errors of the pipeline; each message can be understood alone.

RenderError
├── MeshError (ValueError)       an object that cannot be used, or not with this strategy
│   ├── VoxelError               a volume that cannot be read or used
│   └── ImplicitError            an expression or function that describes no solid
├── StrategyError (ValueError)   an intersection or sampling strategy that is not valid
├── PoseError (ValueError)       poses that cannot be used
├── SweepError                   a sweep that fails, or a worker that cannot take part in it
│   └── PlanError (ValueError)   a plan with an unknown key or a value that is not allowed
├── StudyError                   a study that cannot go on
│   ├── StudyStorageError        something of a study that could not be put on disk
│   └── StudyPlanError (ValueError) a study's plan with an unknown key or a value that is not allowed
├── PlacementError (ValueError)  a placement that cannot be applied
├── RepairError (ValueError)     an option of loading a mesh with a value that is not allowed
├── UntrustedCodeError           code named by a file that the user has not permitted to run
├── ViewError                    a viewer that cannot be started, or a page that cannot be made
├── TrustStoreError              a store of accepted code that cannot be used
└── KernelCacheError             a kernel cache that other users can write, or that cannot be created
"""


class RenderError(Exception):
    """Base of all errors of the pipeline."""

    names_nothing: bool = False
    """Whether a name or path that the user gave stands for nothing: commands report misuse, not a failure."""


class MeshError(RenderError, ValueError):
    """An object that cannot be used, or that lacks what an operation needs, such as a closed surface."""


class VoxelError(MeshError):
    """A volume that cannot be read, or has no surface."""


class ImplicitError(MeshError):
    """An expression or a function that cannot be read, or is no solid."""


class StrategyError(RenderError, ValueError):
    """An intersection or sampling strategy with an unknown or unusable part."""


class PlacementError(RenderError, ValueError):
    """A placement with a value that cannot be applied."""


class RepairError(RenderError, ValueError):
    """An option of mesh repair with a value that is not allowed."""


class PoseError(RenderError, ValueError):
    """Poses of the wrong shape, not finite, or without a rotation."""


class SweepError(RenderError):
    """A sweep that cannot start or fails, or a worker that cannot take part in it."""


class StudyError(RenderError):
    """A study that cannot begin or go on, or an answer that a question does not take."""


class StudyStorageError(StudyError):
    """Something of a study that could not be put on disk; the same call may succeed once there is room."""


class StudyPlanError(StudyError, ValueError):
    """A study's plan with an unknown key or an impossible value; the message names file, line and key.

    Given several arguments, it shows one fault per line.
    """

    def __str__(self) -> str:
        return "\n".join(str(fault) for fault in self.args)


class PlanError(SweepError, ValueError):
    """A plan of a sweep with an unknown key or an impossible value; the message names file, line and key.

    Given several arguments, it shows one fault per line.
    """

    def __str__(self) -> str:
        return "\n".join(str(fault) for fault in self.args)


class UntrustedCodeError(RenderError, ValueError):
    """Code named by a file that the user has not permitted to run; the message lists all such code."""


class ViewError(RenderError):
    """A viewer that cannot be started, or a page that cannot be made."""


class TrustStoreError(RenderError):
    """The store of accepted code cannot be read or written, or other users could write it."""


class KernelCacheError(RenderError):
    """The folder of compiled kernels can be written by other users, or cannot be created."""


class PalpateWarning(UserWarning):
    """Something was repaired, left out or looks wrong; the operation continues."""
