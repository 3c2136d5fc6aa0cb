"""Each primitive once."""

from .hkdf import hkdf_sha256
from .jwe import IV_BYTES, open_jwe, seal_jwe
from .secret import Key

__all__ = ["IV_BYTES", "Key", "hkdf_sha256", "open_jwe", "seal_jwe"]
