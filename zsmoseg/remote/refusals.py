"""What storage behind a URL refuses, in words. Of what it answers nothing is repeated: that may hold secrets."""

from __future__ import annotations

import errno
import re

_STATUS = re.compile(r"status code: (\d{3})")
_CODE = re.compile(r"<Code>(\w+)</Code>")
_SIGNING = re.compile(r"169\.254\.|token request|redential|Account must be|Missing\w*(Account|Key|Secret)")
SIGN_IN = "give credentials in the environment (AWS_*, GOOGLE_*, AZURE_*)"


def is_remote_error(error: BaseException) -> bool:
    """Whether this comes from the library that speaks to storage."""
    return type(error).__module__.startswith("obstore") or "Debug source:" in str(error)


def in_words(error: BaseException) -> tuple[int, str]:
    """The number of the system for what went wrong (``errno``), and words for it."""
    text = str(error)
    status, code = (found[1] if found else "" for found in (_STATUS.search(text), _CODE.search(text)))
    if code == "NoSuchBucket":
        return errno.ENOENT, "there is no such bucket"
    if _SIGNING.search(text) or "Unauthenticated" in type(error).__name__:
        return errno.EACCES, f"no credentials were found; {SIGN_IN}"
    if status in ("401", "403") or "PermissionDenied" in type(error).__name__:
        why = f" ({code})" if code else ""
        return errno.EACCES, f"access was refused{why}; {SIGN_IN} that may read and write there"
    if isinstance(error, FileNotFoundError) or status == "404":
        return errno.ENOENT, "no such file or folder"
    if "RangeNotSupported" in text:  # the rest is asked for once a body broke off
        return (
            errno.EIO,
            "the content ends before the length that the server states, which does not send the rest alone",
        )
    if "NotSupported" in type(error).__name__ or status == "501":
        return errno.EOPNOTSUPP, "the server does not do what is needed (conditional writes, listings)"
    if status:
        return errno.EIO, f"the server answers {status}{f' ({code})' if code else ''}, again and again"
    if "kind: Timeout" in text or "timed out" in text:
        return errno.ETIMEDOUT, "the server does not answer in time, again and again"
    return errno.ECONNREFUSED, "the server cannot be reached; is the endpoint right, and the network up?"
