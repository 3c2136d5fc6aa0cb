"""TLS context of the front end, from a certificate and its key as PEM files."""

from __future__ import annotations

import ssl

from phalanx.errors import UsageError


def tls_context(cert: str, key: str) -> ssl.SSLContext:
    """Return the TLS context for a server. Raises: UsageError: a file cannot be read, or certificate and key differ."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        # An empty password, because OpenSSL would ask for one in the terminal.
        context.load_cert_chain(cert, key, password="")
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise UsageError(
            f"cannot serve HTTPS with {cert} and {key}: {why}",
            "use a certificate and its key as PEM, without a password",
        ) from error
    return context
