"""What a fit to a frequency response shows at a prompt and in a notebook."""

from sysid.base.quantities import number, percent
from sysid.estimation.frequency_fit import ResponseFit
from sysid.notebook.card import Card, Table
from sysid.notebook.page import structure_in_words


class ResponseFitView:
    """A fit to a frequency response."""

    @staticmethod
    def line(result: ResponseFit) -> str:
        """Structure, number of frequencies and error."""
        n, share = len(result.data.w), percent(100.0 * result.share)
        return f"<ResponseFit: {structure_in_words(result.fit)}; {n} frequencies, middle error {share} of the response>"

    @staticmethod
    def card(result: ResponseFit) -> Card:
        """One screen."""
        w = result.data.w
        rows = [
            (p.name, number(p.value, 6), "–" if p.std is None else number(p.std, 3), p.unit)
            for p, initial in zip(result.fit.parameters, result.fit.model.initial, strict=True)
            if not initial
        ]
        return Card(
            structure_in_words(result.fit),
            [
                ("data", f"{len(w)} frequencies, {w[0]:.4g} to {w[-1]:.4g} rad/s"),
                ("error, middle", f"{percent(100.0 * result.share)} of the response"),
                ("deviations", result.errors),
            ],
            [Table(("parameter", "value", "std", "unit"), rows)],
            [f"Warning: {text}." for text in result.fit.warnings],
            call="Next: sysid.plots.response_fit(result), result.fit.save('model.json')",
        )
