"""How this package was installed, and the command that installs it again."""

from __future__ import annotations

__all__ = ["PACKAGE", "install_command"]

PACKAGE = "smartplay-tools"


def install_command(extra: str = "") -> str:
    """Return the command that installs this package with one more extra, from where it was installed and as it was.

    Without an extra, it installs the package again.
    """
    import json
    import sys
    import tomllib
    from importlib.metadata import distribution
    from importlib.util import find_spec
    from pathlib import Path
    from urllib.parse import urlsplit
    from urllib.request import url2pathname

    # https://packaging.python.org/specifications/direct-url: without the file, it came from a package index.
    origin = json.loads(distribution(PACKAGE).read_text("direct_url.json") or "{}")
    receipt = Path(sys.prefix, "uv-receipt.toml")
    extras = {extra} - {""}
    if receipt.exists():
        tool = tomllib.loads(receipt.read_text(encoding="utf-8"))["tool"]
        extras.update(*(each.get("extras", ()) for each in tool["requirements"] if each["name"] == PACKAGE))
        command = "uv tool install --force"
    else:
        python = f'"{sys.executable}"' if " " in sys.executable else sys.executable
        command = f"{python} -m pip install" if find_spec("pip") else f"uv pip install --python {python}"
        command += "" if extra else " --force-reinstall"
    wanted, url = f"[{','.join(sorted(extras))}]" if extras else "", origin.get("url", "")
    if "dir_info" in origin:
        editable = "--editable " if origin["dir_info"].get("editable") else ""
        return f'{command} {editable}"{url2pathname(urlsplit(url).path)}{wanted}"'
    vcs = origin["vcs_info"]["vcs"] + "+" if "vcs_info" in origin else ""
    return f'{command} "{PACKAGE}{wanted}{f" @ {vcs}{url}" if url else ""}"'
