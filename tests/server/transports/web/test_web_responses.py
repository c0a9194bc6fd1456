"""Headers of responses, and documents that a browser has already."""

from __future__ import annotations

import pytest

from catoptra_server.serve.web.page_socket import document_response, text_response
from catoptra_server.serve.web.pages import create_document

DOCUMENT = create_document("text/css; charset=utf-8", b"body {}")


def test_document_has_its_type_its_tag_and_is_asked_for_again() -> None:
    response = document_response(DOCUMENT, known_tags="")
    assert (response.status, response.body) == (200, b"body {}")
    assert response.headers["Content-Type"] == "text/css; charset=utf-8"
    assert response.headers["Cache-Control"] == "no-cache"
    assert response.headers["ETag"] == DOCUMENT.etag


@pytest.mark.parametrize("known", ["{}", "W/{}", '"other", {}', "*"])
def test_document_when_it_is_known_has_no_body(known: str) -> None:
    response = document_response(DOCUMENT, known_tags=known.format(DOCUMENT.etag))
    assert response.status == 304
    assert not response.body
    assert "Content-Security-Policy" in response.headers


@pytest.mark.parametrize("known", ['"other"', "{}x", "x{}"])
def test_document_when_another_is_known_has_its_body(known: str) -> None:
    response = document_response(DOCUMENT, known_tags=known.format(DOCUMENT.etag))
    assert response.status == 200


def test_text_is_plain_and_never_stored() -> None:
    response = text_response(403, "no", headers={"Allow": "GET"})
    assert response.headers["Content-Type"] == "text/plain; charset=utf-8"
    assert response.headers["Cache-Control"] == "no-store"
    assert response.headers["Allow"] == "GET"
