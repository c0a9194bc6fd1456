"""Responses of the web port: each has the headers that keep the page to itself."""

from __future__ import annotations

from collections.abc import Mapping

from aiohttp import web

from catoptra_server.transports.web.page_files import Document

# Scripts, styles and sockets of this address alone, in no frame of another page, sniffed as no
# other type, readable by no other site. The last one hides the versions that aiohttp names.
SECURITY_HEADERS = {
    "Content-Security-Policy": (
        "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Server": "Catoptra",
}
# Kept by browsers, but used only after the server has confirmed that it is the newest.
_REVALIDATED = {"Cache-Control": "no-cache"}


def text_response(
    status: int, reason: str, *, headers: Mapping[str, str] | None = None
) -> web.Response:
    """Response with a reason in plain text."""
    return web.Response(
        status=status,
        body=f"{reason}\n".encode(),
        headers={
            **SECURITY_HEADERS,
            "Content-Type": "text/plain; charset=utf-8",
            "Cache-Control": "no-store",
            **(headers or {}),
        },
    )


def document_response(document: Document, *, known_tags: str) -> web.Response:
    """Response with a document, or without its body for a client that has it.

    Args:
        document: The document.
        known_tags: If-None-Match header of the request; empty if absent.
    """
    headers = {**SECURITY_HEADERS, **_REVALIDATED, "ETag": document.etag}
    # Compared weakly, as RFC 9110 13.1.2 has it.
    tags = {tag.strip().removeprefix("W/") for tag in known_tags.split(",")}
    if tags & {document.etag, "*"}:
        return web.Response(status=304, headers=headers)
    headers["Content-Type"] = document.content_type
    return web.Response(body=document.body, headers=headers)
