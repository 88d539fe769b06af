from study.identify.conftest import found

__all__ = ["found"]
