"""Methods: every way to solve a scene."""

from epcontact.machine import provide_kernel_cache

# Before fem_check, which must not import it, defines its kernels.
provide_kernel_cache()
