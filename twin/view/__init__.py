"""The robot and its records as pictures: window, browser, strip, film."""
