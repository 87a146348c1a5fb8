// Render → denoise → composite: Cycles renders multilayer EXR files, Hush denoises them, and the scene's compositor takes the
// denoised frames. A denoise task starts as soon as its chunk and the frames beside it are rendered.

const JOB_TYPE = {
    label: "Cycles Render, Hush Denoise",
    description: "Render multilayer EXR files, denoise them over time with Hush, and run the compositor over the result",
    settings: [
        { key: "frames", type: "string", required: true,
          eval: "f'{C.scene.frame_start}-{C.scene.frame_end}'",
          evalInfo: { showLinkButton: true, description: "Scene frame range" },
          description: "Frames to render. Examples: '47', '1-30', '3, 5-10, 47-327'" },
        { key: "chunk_size", type: "int32", default: 1, propargs: { min: 1 }, visible: "submission",
          description: "Frames in one render task" },
        { key: "denoise_chunk_size", type: "int32", default: 8, propargs: { min: 1 }, visible: "submission",
          description: "Frames in one denoise task; it reads the frames beside them as well" },
        { key: "window", type: "int32", default: 2, propargs: { min: 0, max: 3 }, visible: "submission",
          description: "Frames on each side that help a frame" },
        { key: "composite", type: "bool", default: true, visible: "submission",
          description: "Run the scene's compositor over the denoised frames; wants the Hush add-on in Blender" },
        { key: "hush_arguments", type: "string", default: "", visible: "submission",
          description: "More options for hush denoise, such as --lambda 4 --aov all" },
        { key: "second_pass", type: "bool", default: false, visible: "submission",
          description: "Average each result with those around it, which flickers less; a task reads twice as many frames beside its own" },
        { key: "hush", type: "string", default: "hush", visible: "hidden",
          description: "The hush program on the workers" },

        { key: "render_output_root", type: "string", subtype: "dir_path", required: true, visible: "submission",
          description: "Base folder of the output; job-specific parts are added to it" },
        { key: "add_path_components", type: "int32", required: true, default: 0, propargs: { min: 0, max: 32 }, visible: "submission",
          description: "Number of folders of the blend file's path to add" },
        { key: "render_output_path", type: "string", subtype: "file_path", editable: false,
          eval: "str(Path(abspath(settings.render_output_root), last_n_dir_parts(settings.add_path_components), jobname, '{timestamp}', 'noisy', '######'))",
          description: "Where the noisy frames go; the denoised ones go to the folder 'denoised' beside theirs" },

        { key: "blendfile", type: "string", required: true, visible: "web", description: "Blend file to render" },
        { key: "format", type: "string", required: true, eval: "C.scene.render.image_settings.file_format", visible: "web" },
        { key: "scene", type: "string", required: true, eval: "C.scene.name", visible: "web", description: "Scene to render" },
    ],
};

const MULTILAYER = ["OPEN_EXR_MULTILAYER", "MULTILAYER"];

function compileJob(job) {
    const settings = job.settings;
    if (MULTILAYER.indexOf(settings.format) < 0) {
        throw `Hush needs the passes of OpenEXR MultiLayer files, and the output format is "${settings.format}"`;
    }
    settings.render_output_path = withTimestamp(settings.render_output_path, job);
    const noisyDir = path.dirname(settings.render_output_path);
    const denoisedDir = path.join(path.dirname(noisyDir), "denoised");

    const renders = authorRenderTasks(settings);
    const denoises = authorDenoiseTasks(settings, noisyDir, denoisedDir, renders);
    for (const task of renders) job.addTask(task.task);
    for (const task of denoises) job.addTask(task);
    if (settings.composite) {
        const composite = authorCompositeTask(settings, denoisedDir, path.join(path.dirname(noisyDir), "composited"));
        for (const task of denoises) composite.addDependency(task);
        job.addTask(composite);
    }
}

function withTimestamp(pattern, job) {
    if (!pattern) throw "no render_output_path setting!";
    return pattern.replace(/{timestamp}/g, formatTimestampLocal(job.created));
}

function authorRenderTasks(settings) {
    return frameChunker(settings.frames, settings.chunk_size).map((chunk) => {
        const task = author.Task(`render-${chunk}`, "blender");
        task.addCommand(author.Command("blender-render", {
            exe: "{blender}",
            exeArgs: "{blenderArgs}",
            argsBefore: [],
            blendfile: settings.blendfile,
            args: [
                ...(settings.scene ? ["--scene", settings.scene] : []),
                "--render-output", settings.render_output_path,
                "--render-format", "OPEN_EXR_MULTILAYER",
                "--render-frame", chunk.replace(/-/g, ".."), // Blender's way to write a range.
            ],
        }));
        return { task: task, frames: framesOf(chunk) };
    });
}

function authorDenoiseTasks(settings, noisyDir, denoisedDir, renders) {
    const more = settings.hush_arguments.split(" ").filter((word) => word.length > 0);
    return frameChunker(settings.frames, settings.denoise_chunk_size).map((chunk) => {
        const task = author.Task(`denoise-${chunk}`, "misc");
        task.addCommand(author.Command("exec", {
            exe: settings.hush,
            args: ["denoise", noisyDir, "--output", denoisedDir, "--frames", chunk, "--window", `${settings.window}`, `--second-pass=${settings.second_pass}`, ...more],
        }));
        const wanted = withNeighbours(framesOf(chunk), settings.second_pass ? 2 * settings.window : settings.window);
        for (const render of renders) {
            if (render.frames.some((frame) => wanted.has(frame))) task.addDependency(render.task);
        }
        return task;
    });
}

function authorCompositeTask(settings, denoisedDir, compositedDir) {
    const task = author.Task("composite", "blender");
    const folders = { output_folder: denoisedDir, composite_folder: compositedDir };
    const lines = ["import bpy"];
    for (const name in folders) lines.push(`bpy.context.scene.hush.${name} = ${pythonString(folders[name])}`);
    lines.push("bpy.ops.hush.composite_shot()");
    task.addCommand(author.Command("exec", {
        exe: "{blender}",
        args: [
            "--background", settings.blendfile,
            ...(settings.scene ? ["--scene", settings.scene] : []),
            "--render-output", settings.render_output_path,
            "--python-exit-code", "1", // A failure in Python fails the task.
            "--python-expr", lines.join("; "),
        ],
    }));
    return task;
}

// The frames of a chunk such as "1-3,7".
function framesOf(chunk) {
    const frames = [];
    for (const part of `${chunk}`.split(",")) {
        const ends = part.match(/^\s*(-?\d+)\s*(?:-\s*(-?\d+))?\s*$/);
        if (!ends) throw `not a chunk of frames: ${chunk}`;
        const first = parseInt(ends[1], 10);
        const last = ends[2] === undefined ? first : parseInt(ends[2], 10);
        for (let frame = first; frame <= last; frame++) frames.push(frame);
    }
    return frames;
}

function withNeighbours(frames, window) {
    const all = new Set();
    for (const frame of frames) {
        for (let offset = -window; offset <= window; offset++) all.add(frame + offset);
    }
    return all;
}

// A Python literal; JSON's strings are Python's too.
function pythonString(text) {
    return JSON.stringify(text);
}
