"""The robot and its records as pictures: window, browser, strip, film."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)
