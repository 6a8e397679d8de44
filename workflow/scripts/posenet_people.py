"""Draw synthetic people to train a pose network with, and others to test it on."""

from job import job, snakemake

with job():
    from cospeech.learning.settings import settings_of
    from cospeech.people.synthetic import write_people
    from cospeech.posenet.training.stages import Settings

    settings = settings_of(Settings(), snakemake.params.settings, "posenet")
    part = snakemake.wildcards.part
    options = {"size": settings.input, "seed": snakemake.params.seed, "labelled": settings.labelled}
    trained = {domain: settings.people[domain] for domain in ("studio", "wild")}
    tested = dict.fromkeys(trained, settings.people["test"])
    write_people(snakemake.output.train, part, trained, **options)
    write_people(snakemake.output.test, part, tested, test=True, **options)
