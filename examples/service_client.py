"""
Ask a server of ranges from another process, by the standard library alone: `mantaray serve
synthetic:beaufort` first.
"""

import http.client
import json
import sys
from typing import Any

FLEET = {
    "A": {"north": 0.0, "east": 0.0, "depth": 50.0},
    "B": {"north": 1500.0, "east": -400.0, "depth": 120.0},
    "C": {"north": -900.0, "east": 2200.0, "depth": 300.0},
}


def ask(
    connection: http.client.HTTPConnection,
    method: str,
    path: str,
    body: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """
    One request by a connection that stays open; what the server refuses is an error with its line.
    """
    connection.request(method, path, None if body is None else json.dumps(body))
    response = connection.getresponse()
    answer: dict[str, Any] = json.loads(response.read())
    if response.status != http.client.OK:
        raise RuntimeError(f"{response.status}: {answer['error']}")
    return answer


def main() -> None:
    """Let each vehicle ping once, ten seconds apart."""
    port = int(sys.argv[1]) if len(sys.argv) > 1 else 8642
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    try:
        connection.connect()
    except ConnectionRefusedError:
        sys.exit(f"nobody listens on port {port}; start `mantaray serve synthetic:beaufort` first")
    print(ask(connection, "GET", "/")["title"])
    for turn, (source, place) in enumerate(FLEET.items()):
        others = [{"name": name, **end} for name, end in FLEET.items() if name != source]
        answer = ask(
            connection, "POST", "/ping", {"time": 10.0 * turn, "source": place, "receivers": others}
        )
        for end in answer["receivers"]:
            when = "not" if end["arrival_time"] is None else f"at {end['arrival_time']:.6f} s"
            print(f"{end['name']} hears {source} {when} ({end['status']})")


if __name__ == "__main__":
    main()
