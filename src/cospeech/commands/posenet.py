"""`cospeech posenet`: data sets for the pose network, and poses from images."""


def add(commands):
    """Register the group."""
    group = commands.add_parser(
        "posenet", help="the pose network: data sets in, poses out", description=__doc__.splitlines()[0]
    )
    actions = group.add_subparsers(title="commands", required=True, metavar="COMMAND")
    _add_prepare(actions)
    _add_predict(actions)


def _add_prepare(actions):
    prepare = actions.add_parser("prepare", help="a data set, as one file for training", description=_prepare.__doc__)
    names = "mpi_inf_3dhp_train, mpi_inf_3dhp_test, h36m, mpii, lsp, lspet or coco_wholebody"
    option = prepare.add_argument
    option("name", metavar="NAME", help=names)
    option("folder", metavar="FOLDER", help="the data set as its owners ship it, unpacked")
    option("--out", required=True, metavar="FILE", help="file to write (.h5)")
    option("--part", choices=["body", "hand", "face"], default="body", help="hand and face are of coco_wholebody")
    option("--every", type=int, metavar="N", help="every N-th frame of a recording (default: docs/posenet_data.md)")
    option("--subset", metavar="NAME", help="train, test, val or all, where the data set has them (default: train)")
    option(
        "--scale", choices=["universal", "metric"], help="size of 3D poses (default: universal for 3DHP, else metric)"
    )
    option("--frame-list", metavar="FILE", help="h36m: CSV of subject, action, camera, frame, instead of --every")
    option("--correction", choices=["none", "yaw", "full"], default="full", help="of the perspective (default: full)")
    option("--size", type=int, default=256, help="side of the network's crop, pixels (default: 256)")
    option("--margin", type=float, default=1.5, help="room around it for augmentation, as a factor (default: 1.5)")
    prepare.set_defaults(run=_prepare)


def _prepare(options):
    """Turn a data set as its owners ship it into one HDF5 file of crops, and tell what was left out and why."""
    from cospeech.posenet.prepare import prepare

    asked = {name: getattr(options, name) for name in ("every", "subset", "scale", "frame_list")}
    count, dropped = prepare(
        options.name,
        options.folder,
        options.out,
        part=options.part,
        correction=options.correction,
        size=options.size,
        margin=options.margin,
        **{name: value for name, value in asked.items() if value is not None},
    )
    print(f"{options.out}: {count} samples of {options.name}")
    for reason, number in dropped.items():
        print(f"  left out {number}: {reason}")


def _add_predict(actions):
    predict = actions.add_parser(
        "predict", help="the 3D pose in an image, or in each of a folder", description=_predict.__doc__
    )
    option = predict.add_argument
    option("source", metavar="IMAGE_OR_FOLDER", help="an image with one person, or a folder of them")
    option("--model", required=True, metavar="FILE", help="network, such as results/posenet/body/model.onnx")
    option("--out", required=True, metavar="FOLDER", help="where pictures, poses.csv and poses.h5 go")
    option(
        "--box",
        type=float,
        nargs=4,
        metavar=("LEFT", "TOP", "RIGHT", "BOTTOM"),
        help="the person, in pixels of every image (default: looked for in the whole image)",
    )
    option("--focal", type=float, metavar="PIXELS", help="focal length (default: an assumed one, the larger side)")
    option("--threads", type=int, help="CPU threads (default: all)")
    predict.set_defaults(run=_predict)


def _predict(options):
    """Draw the 2D and 3D pose of the person in each image, and write them as CSV and HDF5 (millimetres)."""
    from cospeech.posenet.folder import predict_folder

    used, dropped = predict_folder(
        options.source, options.model, options.out, box=options.box, focal=options.focal, threads=options.threads
    )
    print(f"{options.out}: {used} images, {dropped} left out; licence of the network: see {options.model}'s manifest")
