"""Write the checked-in files anew, after a change of what makes them: `python -m vastflow.deployments`."""

from pathlib import Path

from vastflow.deployments.checked_in import checked_in


def main() -> None:
    """Write every file and say which."""
    for name, content in checked_in().items():
        file = Path(__file__).parent / name
        file.parent.mkdir(exist_ok=True)
        file.write_text(content, encoding="utf-8")
        print(file)


if __name__ == "__main__":
    main()
