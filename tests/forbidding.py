"""Makes stages of the bounce loop fail that a scene should not need."""

from raytracer import contributions, integrate, stages


def forbid(monkeypatch, *names):
    """Make the functions of these names fail wherever the bounce loop calls them."""

    def fail(*arguments, **keywords):
        raise AssertionError("a stage was called that the scene does not need")

    for name in names:
        callers = [module for module in (stages, contributions, integrate) if hasattr(module, name)]
        assert callers, f"the bounce loop calls no {name}"
        for module in callers:
            monkeypatch.setattr(module, name, fail)
