# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Every message that an artist reads, by key. Each says what is the matter and which button or field helps; `messages.text` fills in
their fields."""

TEXTS = {
    # Scenes and their settings
    "no_scene": "There is no scene {name}",
    "linked": "The scene is linked from {file}: open that file",
    "engine": "The render engine is {engine}; Hush denoises renders of Cycles: choose Cycles under Render Engine",
    "camera": "The scene has no camera: add one",
    "camera_inactive": "The scene has no active camera: press Fix, or choose one under Scene › Camera",
    "save": "The file is not saved yet, and the output path is beside it (//): save the file first",
    "no_layers": "No view layer is used for rendering: turn on Use for Rendering in a view layer",
    "passes": "View layer {layer} renders without {passes}, which make the result better: press Prepare Shot",
    "follow_reflections": (
        "Follow Reflections of Denoising Data is off in view layer {layer}: the passes show mirrors and clear glass, not what is seen in "
        "them, and Hush makes more errors there. Press Prepare Shot"
    ),
    "albedo_weighting": (
        "Albedo Roughness Weighting of Denoising Data is off in view layer {layer}: glossy and rough metal is black in Denoising Albedo, "
        "so Hush makes more errors there. Press Prepare Shot"
    ),
    "seed": "The seed is not animated: every frame has the same noise, so its neighbours cannot help. Press Prepare Shot",
    "denoising": "Cycles denoises each frame already: that costs time and takes detail that Hush could keep. Press Prepare Shot",
    "motion_blur": (
        "With motion blur the Vector pass of {layers} is empty: neighbours cannot help without a view layer for the vectors. "
        "Press Prepare Shot"
    ),
    "vector_layers": (
        "Several view layers with motion blur take their vectors from one, Vectors From under Settings: "
        "where they show different things, neighbours help less"
    ),
    "single_layer": "Render Single Layer is on: view layer {layer} with the vectors is not rendered. Turn it off",
    "single_layer_of_several": "Render Single Layer is on: of several view layers a window renders the open one only. Turn it off",
    "vector_pass": "View layer {layer} is to give the motion vectors, but does not render them: turn on its Vector pass",
    "vector_blur": "View layer {layer} is to give the motion vectors, but has motion blur: turn off its Motion Blur",
    "format": "The output is {format}: only OpenEXR MultiLayer keeps the passes. Press Prepare Shot",
    "denoised_again": (
        "Denoise node {node} in the compositor denoises once more what Hush has denoised, each frame for itself: turn it off (M, Mute)"
    ),
    "noisy_image": (
        "The compositor takes Noisy Image of view layer {layers}, which is rendered only while Cycles denoises, so it gets nothing: "
        "press Fix to take Image, which is as noisy now"
    ),
    "image_taken": "{count:link} moved from Noisy Image to Image",
    "past_node": (
        "View layer {layers} goes past the Temporal Denoise node, so Composite Denoised leaves it noisy: "
        "press Add Temporal Denoise Node for one behind each Render Layers"
    ),
    "lossy_codec": "The codec {codec} is lossy and blurs the passes: choose ZIP under Output › Codec",
    "half": "The output has 16 bit: very bright pixels and fine steps are lost before denoising. Choose Float (Full) under Output",
    "overwrite_off": "Overwrite is off under Output: frames of an earlier render stay, also where the scene changed",
    "placeholders": "Placeholders are on under Output: empty files stand for frames that are not rendered yet",
    "file_extension": "File Extensions is off under Output, and frames without .exr at their end are not found: press Prepare Shot",
    "sequencer": "The Sequencer has strips and is rendered in place of the scene: turn off Post Processing › Sequencer",
    "lambda_driven": (
        "λ Noise to Keep follows {what}: its value now, {value:g}, is used for all frames. Keyframes are followed, so bake it to keys"
    ),
    "lambda_driver_now": "λ has a driver or NLA strips: its value now is used for all frames",
    "lambda_outside": "λ Noise to Keep is {value:g} at frame {frame}: what is outside {low:g} to {high:g} is cut off",
    "lambda_mask_missing": (
        "View layer {layer} has no shader AOV {name}, which λ Mask AOV names: add one under View Layer › Passes › Shader AOV with the type "
        "Value, and an AOV Output node of that name, with Value 1, to the materials that shall keep noise"
    ),
    "lambda_mask_both": "λ Mask AOV {name} is not looked at, as λ Mask Images are the mask: choose one of the two",
    "frame_step": (
        "Frame Step is {step}: motion vectors point at the frame right beside, which is not rendered, so neighbours cannot help. "
        "Set Frame Step to 1"
    ),
    "path": "The output path of the scene cannot be used: {reason}. Change Output › Output Path",
    "path_number": "The output path {path} has no frame number: write # where it belongs in Output › Output Path",
    "path_camera": (
        "The output path has {{camera_name}} in it, and markers change the camera: the frames of a shot must lie in one folder, with one "
        "name. Choose an Output › Output Path without it"
    ),
    "path_numbers": (
        "The name {name} has # in several places, but Hush finds frames only where all # are the frame number's: "
        "take the others out of {where}, and out of the names of frames that are rendered already"
    ),
    "same_files": (
        "The scenes {one} and {other} render to the same files, {path}: one takes the other's frames for its own. "
        "Give one of them another Output Path"
    ),
    "stereo_one_file": (
        "Stereo: the views go to one file, of which Blender 5 composites only the first. "
        "Set Output › Views Format to Individual before rendering"
    ),
    # Files
    "library": "The Hush library does not load in this Blender: {reason}. Install the extension for this system",
    "folder_same": "The denoised frames would replace the rendered ones in {folder}: choose another folder under Denoised Frames",
    "folder_file": "{place} is a file, not a folder, so frames cannot be written into {folder}: choose another folder {where}",
    "folder_closed": "Nothing can be written into {folder}: {reason}. Choose another folder {where}",
    "files_unread": "The files of the shot cannot be looked at: {reason}",
    "range_empty": "The frame range of the scene is empty: set its Frame Start and End",
    "unrendered_all": "The shot is not rendered yet, there are no frames {path}: {how}",
    "unrendered": "{frames:frame is} not rendered: {how}",
    "space": "The denoised frames need about {needed}, but {free} are free at {place}: make room or choose another folder",
    "first_frame": "{file} cannot be denoised: {reason}",
    "older_size": (
        "{file} has {columns} × {rows} pixels, the scene renders {wanted_columns} × {wanted_rows}: it is of an earlier render. "
        "Press Render Animation"
    ),
    "older_layer": (
        "{file} has no view layer {layers}, only {there}: if one was renamed since it was rendered, give it its old name back, "
        "else press Render Animation"
    ),
    "older_pass": "{file} lacks {passes} of {layer}, turned on since it was rendered: press Render Animation",
    "strange_layers": (
        "{file} has no view layer {layers}, only {there}: if one was renamed since it was rendered, give it its old name back, "
        "else choose other files under Rendered Frames, or render again"
    ),
    "lossy_file": "{file} has lossy compression ({compression}): choose ZIP under Output › Codec and press Render Animation",
    "stale": "{frames:frame is} out of date: {reason}. Press Denoise Shot",
    "frames_are": "{frames:frame is}",
    "failed": "{frames:frame} could not be denoised: {reason}",
    # Composite Denoised
    "composite_no_nodes": "The scene has no compositor nodes: press Add Temporal Denoise Node",
    "composite_folder_same": "Composited frames would replace others in {folder}: choose another folder under Composited Frames",
    "composite_nothing": "No frame of this shot is denoised: press Denoise Shot first",
    "composite_library": "The Hush library is of another version than the extension: install the extension again",
    "composite_unsaved": (
        "{images} in the compositor: the changes are not saved, and the composite is made from what is saved. "
        "Save or pack in an Image Editor, under Image"
    ),
    "composite_copy": "The copy of the file that is composited cannot be saved: {reason}",
    "composite_missing": "{frames:frame is} not denoised: press Denoise Shot",
    "composite_size": "{frames:frame} cannot be composited: {reason}. Press Render Animation, then Denoise Shot",
    "composite_scene": (
        "{frames:frame} cannot be composited: {reason}. Give each scene an Output Path of its own, then press Render Animation; "
        "if it was this one, and was renamed since, give the other scene another name"
    ),
    "composite_damaged": "{frames:frame} cannot be composited: {reason}",
    "composite_failed": "{frames:frame} could not be composited: {reason}",
    "composite_old": "{frames:frame is} out of date ({reason}): composited with the old denoised image",
    "composite_noisy": "{frames:frame is} not denoised ({reason}): composited with noise",
    "composite_stopped": "Compositing was stopped; {count:frame} composited",
    "composite_done": "{count:frame} composited in {clock}, in {folder}",
    "composite_some": "{count} of {total:frame} composited",
    "composite_outputs": "File Output node {node} would replace the frames of the shot and was left out",
    "composite_no_layer": (
        "{file} has no view layer {layer}: if it was renamed since it was rendered, give it its old name back, else press Render Animation"
    ),
    "composite_node_layer": "{file} has no view layer {layer}, nor has the scene: choose another View Layer in the Temporal Denoise node",
    "composite_other_scene": "Scene {scene} is in the composite too: it is rendered again, noisy",
    "composite_layer_off": "View layer {layer} is off for rendering, so it is empty in the composite, as in a render",
    "composite_lost": "The frames do not hold {passes} of view layer {layer}; the composite does without",
    "composite_scripts": (
        "Python of the file was not run for compositing, so its drivers stood still: "
        "turn on Preferences › Save & Load › Auto Run Python Scripts if you trust the file"
    ),
    "composite_addon_node": "Node {node} is of an add-on that is not there in the process that composites: turn the add-on on, or mute it",
    "composite_linked": "The scene is linked from {file}: open that file",
    # Render and Denoise Shot
    "whole_kept": "{frames:frame is} rendered already and kept: turn on Render Again to render all frames",
    "whole_kept_old": (
        "{frames:frame is} rendered already and kept, without what Prepare Shot has set up since: turn on Render Again to render all frames"
    ),
    "whole_failed": "{frames:frame is} not rendered: see what Blender reports, then press Render and Denoise Shot again",
    "whole_stopped": "Rendering was stopped: press Render and Denoise Shot again to go on",
    "whole_no_start": "Blender did not render: see what it reports, and whether the render region is empty, then press the button again",
    "whole_gone": "Scene {name} is gone",
    "whole_done": "{total:frame} rendered and denoised, {rendered} of them now",
    "whole_composited": "{total:frame} rendered, denoised and composited, {rendered} of them rendered now",
    # Check Shot
    "ready": "The shot is ready",
    "problems": "{count:problem}",
    "no_fix": "There is no fix for {key}: press Check Shot to see what there is",
    "right_already": "That was right already",
    # Prepare Shot
    "prepare_engine": "Hush denoises renders of Cycles; the render engine of {scene} is {engine}: choose Cycles under Render Engine",
    "prepare_linked": "The scene {scene} is linked from another file and cannot be changed here: open that file",
    "prepared": "Shot prepared. {changes}",
    "prepared_already": "The shot was prepared already",
    "nothing_prepared": "There is nothing to undo in {scene}: Prepare Shot changed nothing",
    "unprepared": "The settings are as they were before Prepare Shot",
    "unprepared_else": "All other settings are as they were before Prepare Shot",
    "undo_gone": "View layer {layer} is gone, or has another name: what Prepare Shot changed in it stays",
    "undo_layer_gone": "View layer {layer}, which Prepare Shot added, is gone, or has another name: remove it then",
    "undo_by_hand": "{name} was changed since and stays as it is",
    "undo_failed": "{name} could not be put back: {reason}",
    "set_engine": "Render engine: Cycles",
    "set_camera": "Camera of the scene: {camera}",
    "set_passes": "View layer {layer}: {passes} on",
    "set_guide_switch": "View layer {layer}: {switch} on",
    "set_seed": "Sampling: animated seed on",
    "set_denoising": "Sampling: Cycles' own denoising off",
    "set_format": "Output: OpenEXR MultiLayer, ZIP",
    "set_codec": "Output: codec ZIP",
    "set_depth": "Output: 32 bit",
    "set_vector_layer": "View layer {layer} added: 1 sample, without motion blur, for the motion vectors",
    "set_layer_samples": "Sampling: Layer Samples Use, for the one sample; the other view layers render with the scene's",
    "set_vectors_from": "Motion vectors from view layer {layer}",
    "set_overwrite": "Output: Overwrite on",
    "set_placeholders": "Output: Placeholders off",
    "set_file_extension": "Output: File Extensions on",
    "set_sequencer": "Post Processing: Sequencer off",
    "set_single_layer": "Render Single Layer off",
    "set_vector_pass": "View layer {layer}: rendered, Vector on, motion blur off",
    "set_frame_step": "Frame Step: 1",
    # How far a shot is
    "how_render": "press Render Animation",
    "how_prepare": "press Prepare Shot, then Render Animation",
    "how_missing": "render what is missing",
    "how_elsewhere": "render what is missing, or choose another folder under Rendered Frames",
    "status_range_empty": "the scene's frame range is empty: set its Frame Start and End",
    "status_failed": "denoising failed: {reason}",
    "status_unrendered": "no rendered frames in {folder}: {how}",
    "status_none": "not denoised yet: press Denoise Shot",
    "status_done": "{done} of {total:frame} denoised",
    "status_stale": "{count:is} out of date: {reasons}",
    "status_some_failed": "{count} failed: {reason}",
    "status_some_unrendered": "{count:is} not rendered",
    "status_to_do": "{count} to do",
    "status_wrong_size": "denoised at {columns} × {rows}, the scene renders {wanted_columns} × {wanted_rows}",
    "status_rendered": "{count} of {total:frame} rendered",
    "frames_from": "From {path}",
    "frames_to": "To {path}",
    # The node, and why it passes the image through
    "node_there": "The compositor has a Temporal Denoise node already",
    "node_added": "{count:node} added, one behind each Render Layers of a view layer that is denoised",
    "node_tree_linked": "The compositor nodes are linked from another file: add the node there",
    "node_switched_off": "The compositor has nodes, but is off: turn on Use Nodes or, in Blender 5.3, a scene effect, then add the node",
    "node_unlinked": "The compositor has no Render Layers to put the node behind: it was added without links",
    "node_no_editor": "Open the compositor's nodes to add the node there",
    "node_old": (
        "The Temporal Denoise node is of an earlier Hush and shows nothing: press Fix to replace it; its links and settings are kept"
    ),
    "node_broken": (
        "The inside of the node {node} was copied, changed, or opened in a newer Blender since Hush made it, so it passes the image "
        "through: press Fix to make it anew"
    ),
    "node_replaced": "{count:node} made anew",
    "node_off": "The image passes through: {reason}",
    "node_linked": "the node is linked from {file}, and linked nodes show nothing; add one in this file",
    "node_inside": "the inside of the node was copied, changed, or opened in a newer Blender since Hush made it; press Check Shot and Fix",
    "node_owners": "the scenes {scenes} use this node and have different frames; choose one as its Scene",
    "node_stereo": "stereo views are put in by Composite Denoised only",
    "node_stretch": "time is stretched, which files of frames cannot follow; set Time Stretching Old and New to the same",
    "node_rendered": "this frame was rendered by itself and is newer than its file; press Render Animation, then Denoise Shot",
    "node_stale": "this frame is out of date: {reason}; press Denoise Shot",
    "node_missing": "this frame is not denoised yet; press Denoise Shot",
    "node_failed": "this frame could not be denoised: {reason}",
    "node_unrendered": "this frame is not rendered; {how}",
    "node_layer": "the denoised frame has no view layer {layer}; choose another as the node's View Layer",
    "node_unknown": "its files have not been looked at yet",
    # Denoise Shot
    "folder_replaces": "The denoised frames would replace the rendered ones in {folder}: choose another folder, such as {other}",
    "names_kept": "Denoised frames keep the names of the rendered ones ({file}), so {name} cannot be used: give a folder as Output",
    "denoising_frames": "Denoising {count:frame}",
    "denoising_frame": "Denoising frame {frame}",
    "frame_wrong": "Frame {frame}: {reason}",
    "denoise_stopped": "Denoising was stopped; {count:frame} denoised. Press Denoise Shot again to go on",
    "denoise_more": "and {count:error} more",
    "denoise_some": "{there} of {wanted:frame is} denoised",
    "denoise_nothing": "Nothing was denoised",
    "degraded": "{frames:frame is} denoised without a neighbour whose file is bad: render that one again",
    "denoise_done": "{count:frame} denoised in {clock}",
    "denoise_kept": "{done}, {count:frame was} there already",
    "compositing": "Compositing frame {frame}",
    "compositing_all": "Compositing {count:frame}",
    # Work that another process does
    "job_starting": "Starting",
    "job_todo": "{count:frame} to denoise",
    "job_stopping": "Stopping after this frame",
    "job_running": "Scene {scene} is being {doing}; wait for it, or stop it with Esc",
    "job_busy": "The shot is being {doing}; Esc stops it",
    "job_no_start": "The process that {does} cannot be started: {reason}",
    "job_killed": "it was killed by signal {signal}",
    "job_no_memory": "it was killed, most likely as memory ran out",
    "job_exit": "exit code {code}",
    "job_exit_words": "exit code {code}: {words}",
    "job_ended": "The process that {does} ended before its time: {reason}. Frames that were finished are kept",
    "job_no_python": "Blender's Python is not where it should be, in {folder}: install Blender again",
    # Denoise This Frame
    "preview_unrendered": "Frame {frame} is not rendered, there is no {file}: {how}, or go to a frame that is",
    "preview_stopped": "Denoise This Frame was stopped",
    "preview_alone": "Frame {frame} denoised by itself in {seconds:.1f} s, λ {lam:g}",
    "preview_helped": "Frame {frame} denoised with {frames:frame} in {seconds:.1f} s, λ {lam:g}",
    "preview_choose": "{done}. Choose the image {image} in an Image Editor to see it",
    "preview_running": "Denoising this frame",
    "preview_region": "Only the render region",
    "preview_about": "Frame {frame}, λ {lam:g}, window {window}: {seconds:.1f} s",
    "preview_change": "Changes by {change:.1%} from the frame before",
    "preview_scale": "White: {most:.0%} and more. Blue: not in the frame before",
    "preview_no_flicker": "Press With Flicker to see it",
}

# Why a denoised frame is not what denoising now would give, by `kind` of `hush.check_sequence`.
STALE = {
    "lambda": "λ Noise to Keep changed",
    "lambda_masked": "λ in the Mask changed",
    "lambda_pass": "λ Mask AOV changed",
    "lambda_images": "λ Mask Images changed",
    "lambda_image": "its mask image changed",
    "window": "the Window changed",
    "layers": "the view layers changed",
    "view": "the stereo views changed",
    "vector_layer": "Vectors From changed",
    "guides": "the guides changed",
    "passes": "the passes changed",
    "aovs": "Light Passes changed",
    "keep_noisy": "Keep Noisy Image changed",
    "skip": "what is left out changed",
    "second_pass": "Second Pass changed",
    "model": "this Hush has other weights",
    "revision": "this Hush denoises it differently",
    "renderer": "the renderer changed",
    "several": "several settings changed",
    "input_changed": "the render changed",
    "input_missing": "its rendered frame is gone",
    "input_damaged": "its rendered frame is damaged",
    "neighbours": "a frame beside it changed",
    "output_damaged": "the denoised file is damaged",
    "output_changed": "the denoised file was changed by another program",
    "unfinished": "denoising was stopped",
    "failed": "denoising failed",
    "foreign": "not written by Hush",
}

# Numbers of errors, and settings that the library advises, in the words of buttons and fields.
FOR_ARTISTS = (
    (r"\[Errno \d+\] ", ""),
    (r" ?\(os error \d+\)", ""),
    (r"set window to 0\b", "set Window to This Frame Only"),
    (r"set vector layer to '([^']*)'", r"choose \1 under Vectors From"),
    (r"set vector layer to NAME", "choose it under Vectors From"),
    (r"set aovs to none", "turn Light Passes off"),
    (r"set output to DIR, or write it into hush\.toml", "choose a folder under Denoised Frames"),
    (
        r"choose another output folder or set overwrite to true to replace what is there",
        "choose another folder under Denoised Frames, or delete them",
    ),
    (r"denoise again and set overwrite to true", "choose another folder under Denoised Frames"),
    (r",? or set overwrite to true", ", or choose another folder under Denoised Frames"),
    (r"set enable to true to denoise it all the same", "ask who prepared the shot"),
)
