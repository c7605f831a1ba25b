"""What can go wrong in the pipeline; each message is complete in itself.

RenderError
├── MeshError (ValueError)       an object that cannot be used, or not for this strategy
│   ├── VoxelError               a volume that cannot be read or used
│   └── ImplicitError            an expression or function that is no solid
├── StrategyError (ValueError)   a strategy or sampling that is not one
├── PoseError (ValueError)       poses that cannot be used
├── SweepError                   a sweep that cannot be made, or not by this worker
│   └── PlanError (ValueError)   a plan with a value that cannot be
├── PlacementError (ValueError)  a placement that cannot be applied
├── RepairError (ValueError)     an option of loading a mesh that cannot be
├── UntrustedCodeError           code that data name, and that nobody has permitted
├── TrustStoreError              a store of accepted code that cannot be used
└── KernelCacheError             a cache of compiled kernels that others can write, or that cannot be made
"""


class RenderError(Exception):
    """Base of all errors of the pipeline."""


class MeshError(RenderError, ValueError):
    """A mesh that cannot be used, or not for what was asked."""


class VoxelError(MeshError):
    """A volume that cannot be read, or has no surface."""


class ImplicitError(MeshError):
    """An expression or a function that cannot be read, or is no solid."""


class StrategyError(RenderError, ValueError):
    """An intersection or sampling strategy with an unknown or unusable part."""


class PlacementError(RenderError, ValueError):
    """A placement with a value that cannot be applied."""


class RepairError(RenderError, ValueError):
    """An option of how a mesh is mended, with a value that cannot be."""


class PoseError(RenderError, ValueError):
    """Poses of the wrong shape, not finite, or without a rotation."""


class SweepError(RenderError):
    """A sweep that cannot be made, goes wrong, or a worker that cannot take part."""


class PlanError(SweepError, ValueError):
    """A plan of a sweep with an unknown key or an impossible value; the message names file, line and key.

    Several faults, given as several arguments, are told one a line.
    """

    def __str__(self) -> str:
        return "\n".join(str(fault) for fault in self.args)


class UntrustedCodeError(RenderError, ValueError):
    """Code that data name and that nobody has permitted to run; the message lists all of it."""


class TrustStoreError(RenderError):
    """The store of accepted code cannot be read or written, or others could write it."""


class KernelCacheError(RenderError):
    """Others can write the folder from which compiled kernels are run, or it cannot be made."""


class PalpateWarning(UserWarning):
    """Something was mended, dropped or looks wrong; the work goes on."""
