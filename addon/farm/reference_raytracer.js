// A job type for Flamenco (flamenco.blender.org, "Job Types"): copy it into the manager's folder `scripts`.
//
// A picture is cut into tiles that are rendered apart and then merged, as addon/farm/still.yaml does; with no tiles, the
// frames of an animation are rendered, as addon/farm/frames.yaml does. A task that failed is simply run again.
"use strict";

const JOB_TYPE = {
    label: "Reference Ray Tracer",
    description: "Render the frames of an animation, or one picture in tiles",
    settings: [
        { key: "frames", type: "string", required: true, eval: "f'{C.scene.frame_start}-{C.scene.frame_end}'",
          description: "Frames to render, such as '1-24'; of a picture in tiles, its frame" },
        { key: "tiles", type: "int32", default: 0, description: "Tiles of one picture; 0 renders whole frames" },
        { key: "samples", type: "int32", default: 0, description: "Samples per pixel; 0 takes those of the file" },
        { key: "size", type: "string", required: true,
          eval: "f'{C.scene.render.resolution_x * C.scene.render.resolution_percentage // 100}x" +
              "{C.scene.render.resolution_y * C.scene.render.resolution_percentage // 100}'",
          description: "Width x height" },
        { key: "output", type: "string", subtype: "file_path", required: true,
          description: "The .png or .exr files to write, #### for the frame's number" },
        { key: "python", type: "string", default: "python",
          description: "A Python with the ray tracer, the add-on and bpy, on every worker" },
        { key: "blendfile", type: "string", required: true, visible: "web", description: "The .blend to render" },
    ],
};

function compileJob(job) {
    if (job.settings.tiles > 0) {
        addTiles(job, job.settings);
    } else {
        addFrames(job, job.settings);
    }
}

// Returns a task that runs a command of Python's.
function makeTask(name, type, settings, args) {
    const task = author.Task(name, type);
    task.addCommand(author.Command("exec", { exe: settings.python, args: ["-m"].concat(args.map(String)) }));
    return task;
}

// Returns the arguments that stand in for settings of the file.
function listChanges(settings) {
    return ["--size", settings.size].concat(settings.samples > 0 ? ["--samples", settings.samples] : []);
}

function addFrames(job, settings) {
    for (const frame of frameChunker(settings.frames, 1)) {
        job.addTask(makeTask(`frame-${frame}`, "blender", settings, [
            "addon", "render", settings.blendfile, "-o", settings.output, "--frames", `${frame}-${frame}`,
            ...listChanges(settings), "--skip-existing",
        ]));
    }
}

function addTiles(job, settings) {
    const frame = frameChunker(settings.frames, 1)[0];
    // The last run of # in the file's name, as `addon render --frames` has it; those of folders stay.
    const picture = settings.output.replace(/#+(?=[^#\\/]*$)/, (run) => frame.padStart(run.length, "0"));
    const scene = `${picture}.scene.npz`;
    const written = makeTask("export", "blender", settings, [
        "addon", "export", settings.blendfile, "-o", scene, "--frame", frame, ...listChanges(settings),
    ]);
    job.addTask(written);
    const films = [];
    const tasks = [];
    for (let tile = 1; tile <= settings.tiles; tile++) {
        films.push(`${picture}.tile_${tile}.npz`);
        const task = makeTask(`tile-${tile}`, "misc", settings, [
            "raytracer", "render", scene, "-o", films[tile - 1], "--tile", `${tile}/${settings.tiles}`,
        ]);
        task.addDependency(written);
        job.addTask(task);
        tasks.push(task);
    }
    const merge = makeTask("merge", "blender", settings, [
        "addon", "merge", settings.blendfile, ...films, "-o", picture, "--frame", frame,
    ]);
    for (const task of tasks) {
        merge.addDependency(task);
    }
    job.addTask(merge);
}
