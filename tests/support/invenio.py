"""A server of InvenioRDM's drafts, written from its documentation: it refuses what the real one refuses."""

import contextlib
import hashlib
import json
import re
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import unquote

TOKEN, UNSCOPED = "secret-token-of-jane", "secret-token-without-scope"
LICENSES = {"cc-by-4.0", "mit"}
MOST_BYTES = 2_000_000


class Refused(Exception):
    def __init__(self, status, message, errors=(), **headers):
        super().__init__(message)
        self.status, self.headers = status, headers
        self.body = {"status": status, "message": message, **({"errors": [*errors]} if errors else {})}


class Repository:
    """Drafts of a server, and what it was asked.

    Attributes:
        drafts: Id to pids, metadata, and files.
        asked: Method and path of each request.
        instead: Pattern of `METHOD PATH` to the answers that are given once each: status, headers, and bytes, or None for silence.
    """

    def __init__(self):
        self.drafts, self.asked, self.instead, self.headers = {}, [], {}, []
        self.spent_dois = set()
        self.silence = threading.Event()

    def answer(self, method, path, headers, body):
        self.asked.append(f"{method} {path}")
        self.headers.append(dict(headers))
        if (token := headers.get("Authorization", "").removeprefix("Bearer ")) not in (TOKEN, UNSCOPED):
            raise Refused(401, "The server could not verify that you are authorized to access the URL requested.")
        if token == UNSCOPED:
            raise Refused(403, "Permission denied.")
        for pattern, answers in self.instead.items():
            if answers and re.fullmatch(pattern, f"{method} {path}"):
                return answers.pop(0)
        if (method, path) == ("POST", "/api/records"):
            name = f"d{len(self.drafts) + 1}-x"
            self.drafts[name] = {"pids": {}, "metadata": {}, "files": {}}
            return 201, {}, self.described(name, self.read_json(headers, body))
        found = re.fullmatch(
            r"/api/records/([^/]+)/draft(?:/(pids/doi|files)(?:/([^/]+))?(?:/(content|commit))?)?", path
        )
        if found is None or found[1] not in self.drafts:
            raise Refused(404, "The persistent identifier does not exist.")
        name, part, key, action = (each and unquote(each) for each in found.groups())
        draft = self.drafts[name]
        if part is None:
            if method == "PUT":
                return 200, {}, self.described(name, self.read_json(headers, body))
            return 200, {}, self.shown(name)
        if part == "pids/doi":
            if name in self.spent_dois:
                errors = [{"field": "pids.doi", "messages": ["A PID already exists for type doi"]}]
                raise Refused(400, "A validation error occurred.", errors)
            self.spent_dois.add(name)
            draft["pids"] = {
                "doi": {"identifier": f"10.5281/zenodo.{name}", "provider": "datacite", "client": "datacite"}
            }
            return 201, {}, self.shown(name)
        return self.file(draft["files"], method, key, action, headers, body)

    def read_json(self, headers, body):
        if headers.get("Content-Type") != "application/json":
            raise Refused(415, "Unsupported media type 'text/plain' in 'Content-Type' header.")
        try:
            return json.loads(body)
        except ValueError:
            raise Refused(400, "Unable to decode JSON data in request body.") from None

    def described(self, name, value):
        draft = self.drafts[name]
        draft["metadata"], draft["pids"] = value.get("metadata", {}), value.get("pids", {})
        metadata, errors = draft["metadata"], []
        for field in ("resource_type", "title", "publication_date", "creators", "publisher"):
            if not metadata.get(field):
                errors.append({"field": f"metadata.{field}", "messages": ["Missing data for required field."]})
        for k, each in enumerate(metadata.get("creators", ())):
            who = each["person_or_org"]
            if not who.get("family_name" if who["type"] == "personal" else "name"):
                errors.append({"field": f"metadata.creators.{k}", "messages": ["Name cannot be blank."]})
        for k, each in enumerate(metadata.get("rights", ())):
            if "id" in each and (len(each) > 1 or each["id"] not in LICENSES):
                errors.append({"field": f"metadata.rights.{k}", "messages": [f"Invalid value {each['id']}."]})
        for field in ("resource_type", "languages"):
            for each in [*filter(None, [metadata.get(field)])] if field == "resource_type" else metadata.get(field, ()):
                if "title" in each:
                    errors.append({"field": f"metadata.{field}.title", "messages": ["Unknown field."]})
        return {**self.shown(name), **({"errors": errors} if errors else {})}

    def shown(self, name):
        draft = self.drafts[name]
        metadata = dict(draft["metadata"])
        if "languages" in metadata:
            metadata["languages"] = [{**each, "title": {"en": "English"}} for each in metadata["languages"]]
        access = {"record": "public", "files": "public"}
        return {"id": name, "pids": draft["pids"], "metadata": metadata, "access": access, "is_published": False}

    def file(self, files, method, key, action, headers, body):
        if key is None and method == "POST":
            for each in self.read_json(headers, body):
                if each["key"] in files:
                    raise Refused(400, f"File with key {each['key']} already exists.")
                files[each["key"]] = None
        elif key is not None and key not in files:
            raise Refused(404, f"File with key {key} does not exist.")
        elif (method, action) == ("PUT", "content"):
            if headers.get("Content-Type") != "application/octet-stream":
                raise Refused(415, "Unsupported media type in 'Content-Type' header.")
            files[key] = body
        elif (method, action) == ("POST", "commit"):
            if (content := files[key]) is None:
                raise Refused(400, "File content was not uploaded.")
            checksum = f"md5:{hashlib.md5(content).hexdigest()}"
            return 200, {}, {"key": key, "status": "completed", "checksum": checksum, "size": float(len(content))}
        elif (method, action) == ("DELETE", None):
            del files[key]
            return 204, {}, b""
        entries = [{"key": each, "status": "pending" if files[each] is None else "completed"} for each in files]
        return (201 if method == "POST" else 200), {}, {"enabled": True, "entries": entries}


@contextlib.contextmanager
def served():
    """Serve a repository at its `url`, and yield it."""
    repository = Repository()

    class Handler(BaseHTTPRequestHandler):
        def do(self):
            try:
                if "Content-Length" not in self.headers and self.command == "PUT":
                    raise Refused(411, "Length Required")
                size = int(self.headers.get("Content-Length") or 0)
                if size > MOST_BYTES:
                    raise Refused(413, "The data value transmitted exceeds the capacity limit.")
                answer = repository.answer(self.command, self.path, self.headers, self.rfile.read(size))
                if answer is None:
                    repository.silence.wait(20)
                    return
                status, headers, body = answer
            except Refused as refused:
                status, headers, body = refused.status, refused.headers, refused.body
                self.close_connection = True
            content = body if isinstance(body, bytes) else json.dumps(body).encode()
            self.send_response(status)
            for name, value in {**headers, "Content-Length": len(content)}.items():
                self.send_header(name, str(value))
            self.end_headers()
            self.wfile.write(content)

        do_GET = do_POST = do_PUT = do_DELETE = do
        protocol_version = "HTTP/1.1"

        def log_message(self, *arguments):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    repository.url = f"http://127.0.0.1:{server.server_port}"
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield repository
    finally:
        repository.silence.set()
        server.shutdown()
        server.server_close()
