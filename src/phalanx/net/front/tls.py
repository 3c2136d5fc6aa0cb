"""HTTPS at the front end: a certificate and its key, as PEM files."""

from __future__ import annotations

import ssl

from phalanx.errors import UsageError


def tls_context(cert: str, key: str) -> ssl.SSLContext:
    """Return what serves HTTPS. Raises: UsageError: a file cannot be read, or they do not belong together."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        # Without a password, which it would ask for in the terminal.
        context.load_cert_chain(cert, key, password="")
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise UsageError(
            f"cannot serve HTTPS with {cert} and {key}: {why}", "a certificate and its key as PEM, without a password"
        ) from error
    return context
