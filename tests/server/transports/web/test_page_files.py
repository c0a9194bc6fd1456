"""The files of the page by address."""

from __future__ import annotations

from pathlib import Path

from catoptra_server.serve.web.pages import (
    STATIC_FOLDER,
    create_document,
    read_page_files,
)


def test_files_are_found_by_address_with_their_types(tmp_path: Path) -> None:
    (tmp_path / "panels").mkdir()
    contents = {
        "index.html": "<!DOCTYPE html>",
        "style.css": "body {}",
        "panels/map.js": "export {};",
        "icon.svg": "<svg/>",
        "notes.py": "secret",
        "README": "secret",
    }
    for name, text in contents.items():
        (tmp_path / name).write_text(text)
    files = read_page_files(tmp_path)
    assert {path: file.content_type for path, file in files.items()} == {
        "/": "text/html; charset=utf-8",
        "/static/style.css": "text/css; charset=utf-8",
        "/static/panels/map.js": "text/javascript; charset=utf-8",
        "/static/icon.svg": "image/svg+xml",
    }
    assert files["/static/panels/map.js"].body == b"export {};"


def test_folder_without_a_page_has_no_index(tmp_path: Path) -> None:
    assert read_page_files(tmp_path) == {}
    assert read_page_files(tmp_path / "missing") == {}


def test_tag_changes_with_the_body_alone() -> None:
    first, same, other = (create_document("text/plain", body) for body in (b"a", b"a", b"b"))
    assert first.etag == same.etag != other.etag
    assert first.etag.startswith('"')
    assert first.etag.endswith('"')


def test_every_file_of_the_page_but_licences_is_served() -> None:
    files = [file for file in STATIC_FOLDER.rglob("*") if file.is_file()]
    served = read_page_files()
    assert "/" in served
    assert len(served) == len([file for file in files if "LICENSE" not in file.name])
