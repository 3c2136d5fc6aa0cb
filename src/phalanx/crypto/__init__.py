"""Each primitive once."""

from .hkdf import hkdf_sha256
from .jwe import IV_BYTES, jwe_iv, open_jwe, seal_jwe
from .secret import Key

__all__ = ["IV_BYTES", "Key", "hkdf_sha256", "jwe_iv", "open_jwe", "seal_jwe"]
