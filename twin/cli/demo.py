"""`qpal demo`: from nothing to a report, the truth beside it."""

from twin.cli import console, options
from twin.cli.output import output_folder, run_folder

JOINT, TS = "thigh", 0.1  # [s]
RECORD = {"jitter": 0.5, "shrink": 0.4}  # a sweep whose times and levels are drawn
DURATION = 125.0  # [s]
SHARES = (0.1, 0.85, 0.05)  # of the time: simulating, fitting, drawing


def demo(out: options.Out = None, as_json: options.Json = False) -> None:
    """Simulate a leg and identify its joint: a report, beside the truth.

    A first run compiles, once on a machine: about 25 s in place of 10.

    Limit: one record of 125 s and five starts. Progress: each search.
    """
    import twin
    from sysid.report import identify as identified
    from sysid.report.page import write
    from sysid.structures import ActuatedJoint
    from sysid.workflow.identification import identify_file
    from sysid.workflow.saved import export
    from sysid.workflow.setting import Setting
    from twin.report import demo as report
    from twin.studies.beyond import twin_truth

    with console.progress(3, SHARES, not as_json) as step:
        with run_folder(out, "demo") as (folder, scratch):  # the log first: what the report names can be run
            step(f"simulating {DURATION:g} s of the {JOINT}")
            twin.Experiment(JOINT, "sweep", DURATION, TS, 1, options=RECORD).run().save(scratch / "log.csv")
        with output_folder(folder) as scratch:
            step("fitting")
            setting = Setting(ActuatedJoint())
            result = identify_file(folder / "log.csv", setting, progress=console.Searches(step))
            step("drawing")
            true = twin_truth(JOINT, TS)
            exports = export(result.evaluation, scratch, result.record.signals)
            page = report.page(identified.page(result, exports), result, true, folder / "log.csv")
            summary = {**result.as_dict(), "truth": true}
            write(scratch, page, summary)
    console.finish(folder, summary, as_json, [], report.open_values(result, folder / "log.csv"), page.answer)
