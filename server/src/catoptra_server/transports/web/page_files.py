"""The files of the page, read once: a request selects one by its address, and names no path."""

from __future__ import annotations

import hashlib
from pathlib import Path

from catoptra_protocol.slotted_dataclass import dataclass

STATIC_FOLDER = Path(__file__).with_name("static")
INDEX = "index.html"
# Browsers run no script of another type, since the type is not to be guessed (nosniff).
_CONTENT_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".txt": "text/plain; charset=utf-8",
}


@dataclass(frozen=True, slots=True)
class Document:
    """What a GET request reads."""

    content_type: str
    body: bytes
    etag: str
    """Changes with the body: browsers ask again, and get the body only if it has changed."""


def create_document(content_type: str, body: bytes) -> Document:
    """Document with the tag of its body."""
    return Document(content_type, body, f'"{hashlib.sha256(body).hexdigest()[:32]}"')


def read_page_files(folder: Path = STATIC_FOLDER) -> dict[str, Document]:
    """Files by the path of their address: `/` for the page itself, others under `/static/`."""
    documents: dict[str, Document] = {}
    for file in sorted(folder.rglob("*")):
        content_type = _CONTENT_TYPES.get(file.suffix)
        if content_type is not None and file.is_file():
            document = create_document(content_type, file.read_bytes())
            documents[f"/static/{file.relative_to(folder).as_posix()}"] = document
    index = documents.pop(f"/static/{INDEX}", None)
    return documents if index is None else {"/": index, **documents}
