#include "acmp_mapping/reconstruction/reconstruct_options.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/mapping/dense_mapper.h"
#include "acmp_mapping/mesh/distance_volume.h"

namespace acmp {
namespace {

constexpr const char* kStageGroup = "Stages, for several machines (scripts/acmp_cluster.py; docs/offline.md)";
constexpr const char* kFooter = R"(
SCENE is a folder of images with known camera poses, in one of two layouts:
  colmap   images/ and a COLMAP model (cameras, images, points3D as .txt or .bin) in SCENE, SCENE/sparse or
           SCENE/sparse/0. Images with lens distortion are undistorted on the fly.
  mvsnet   images/00000000.jpg ..., cams/00000000_cam.txt ... and pair.txt, as MVSNet and ACMP use it.
"auto" takes mvsnet when it is there, with the landmarks of a COLMAP model beside it.

OUTPUT is a folder that is made; afterwards it holds, for image 0, 1, 2, ... of the scene:
  depth/000000.pfm         depth z in the scene's unit (metres if the poses are), 0 = unknown or masked
  depth/000000.png         the same in thousandths, 16 bit; depth/000000.dmb with --dmb
  normal/000000.pfm        unit normals in the camera's frame
  cost/000000.pfm          matching cost, 0 = perfect to 2 = no view confirms it, filled in; two values stand for more:
                           1.9999999 = filled in where a view had confirmed something;
                           inf = the other views speak against the depth: no point
  confidence/000000.pfm    0..1
  pictures/000000_*.png    the four maps as colour pictures to look at
  fused.ply                one point cloud of all images: position, normal, colour, confidence
  cameras.txt              cameras of the maps (at the maps' size) with their poses
  camera.yaml              with --refine-poses, where the calibration turns out to leave radial distortion: one that does
                           not, for the frontend or the mapper's calibration_file
  colmap/                  with --colmap: the undistorted images, sparse/, depth and normal maps in stereo/
  summary.json, run.txt    what was done, with which settings, and how long it took
  files.txt                names and sizes of all these files

A run that was interrupted goes on where it stopped when the same command is given again; the result is the same to
the last bit (with --schedule online it starts anew). Until then OUTPUT/work holds intermediate maps: about 50 bytes per
pixel and image. GPUs write only what they have no room for, and make the rest
again; on long runs that is up to 20 bytes for each pass over an image. Damaged ones are made again, and so is a
finished run that lacks files or has some of another size.

Depths are searched in the range that the dataset names (mvsnet: last line of cams/*_cam.txt), else in the range of the
landmarks that the image observes, both widened by half at each end. --depth-min and --depth-max override that.

Examples:
  acmp_reconstruct ~/scenes/office /tmp/office
  acmp_reconstruct ~/scenes/office /tmp/office_small --max-image-size 640 --device cpu
  acmp_reconstruct ~/scenes/office /tmp/office --mesh /tmp/office/mesh.ply
  acmp_reconstruct ~/scenes/office /tmp/office_online --schedule online --source-views 7

Exit codes: 0 done, 2 wrong use or input, 1 failed or interrupted.)";

/// The options that are flags, numbers or one of several words, by their names on the command line, with their bounds.
OptionList OptionsOf(ReconstructOptions* o) {
  OptionList list;
  list.Text("--format", &o->format, "Layout of SCENE").choices = {"auto", "colmap", "mvsnet"};
  list.Text("--pixel-centers", &o->pixel_centers,
            "Of mvsnet: where K has the centre of the first pixel, integer: (0, 0), half: (0.5, 0.5), as K of COLMAP\n"
            "that was copied (colmap2mvsnet.py)")
      .choices = {"integer", "half"};
  list.Text("--wide-faces", &o->wide_faces,
            "auto: images of lenses that see more than 120 degrees become several pinhole images with one centre\n"
            "each, the faces of a cube; off: one each, which loses the rim")
      .choices = {"auto", "off"};
  list.Number("--field-of-view", &o->field_of_view, 0, 360, "deg",
              "From side to side, of lenses whose image ends at a circle: what lies outside does not count. 0:\n"
              "all of the image is seen, up to where the distortion's coefficients hold");

  list.Group("Matching");
  list.Text("--preset", &o->preset,
            "balanced: everything; online: everything with fewer iterations, half of the time or less (not tied to\n"
            "--schedule online); acmh, acmm, acmp_no_geometric, acmp: the papers' systems, for comparison")
      .choices = PresetNames();
  list.Number("--max-image-size", &o->max_image_size, 0, 65536, "px",
              "Shrink images so that the longer side has at most this many pixels; 0: as stored");
  list.Number("--source-views", &o->source_views, 1, kMaxSourceViews, "", "Images to match each image against");
  list.Number("--min-source-views", &o->min_source_views, 0, kMaxSourceViews, "",
              "An image with fewer useful source views gets no map; 0: 1 offline, 2 online");
  const Option poses = OptionsOf(&o->pose_refinement).Find("refine_poses");
  list.Add("--refine-poses", poses.sentence, poses.get, poses.set).choices = poses.choices;

  list.Group("Schedule");
  list.Text("--schedule", &o->schedule,
            "offline: all images know each other; online: images come one by one in the order of their index and are\n"
            "matched within a sliding window, as in the ROS nodelet (pair.txt is not used then)")
      .choices = {"offline", "online"};
  DenseMapperOptions mapper;
  const OptionList of_mapper = OptionsOf(&mapper);
  const Option &window = of_mapper.Find("window_size"), &lookahead = of_mapper.Find("lookahead");
  list.Number("--window-size", &o->window_size, window.min, window.max, "", "Online: " + window.sentence);
  list.Number("--lookahead", &o->lookahead, lookahead.min, lookahead.max, "", "Online: " + lookahead.sentence);
  list.Flag("--refine-again", &o->refine_again, "Online: " + of_mapper.Find("refine_again").sentence);

  list.Group("Machine");
  list.Text("--device", &o->device, "auto: a GPU if there is one").choices = {"auto", "cuda", "cpu"};
  list.Number("--jobs-per-gpu", &o->jobs_per_gpu, 1, 64, "",
              "Images under way at once on each GPU: while one is triangulated or written, others are matched");
  list.Number("--threads", &o->threads, 0, 4096, "", "CPU threads; 0: one per core");
  list.Number("--memory-limit-gb", &o->memory_limit_gb, 0, 1e6, "",
              "Memory for images, maps and points that are kept at hand; by default a quarter of this machine's or "
              "container's");

  list.Group("Output");
  list.Number("--mesh-voxel-size", &o->mesh_voxel_size, 0, 1e9, "",
              "Details of the mesh, scene units; 0: 2.5 pixels at the median depth");
  list.Flag("--dmb", &o->dmb, "Also write depth as .dmb (Gipuma, ACMP)");
  list.Flag("--colmap", &o->colmap,
            "Also write OUTPUT/colmap, COLMAP's dense workspace, for colmap stereo_fusion, OpenMVS, trainers of splats "
            "and\nothers. Its depth maps leave out pixels that no view confirms, those of cost 2");
  list.Flag("--no-pictures", &o->no_pictures, "No colour pictures of the maps");
  list.Flag("--overwrite", &o->overwrite, "Start afresh: remove what an earlier run left in OUTPUT");
  list.Flag("--keep-work", &o->keep_work, "Keep OUTPUT/work at the end");
  list.Flag("--quiet", &o->quiet, "No progress; only warnings and errors");

  list.Group(kStageGroup);
  list.Flag("--stages", &o->stages,
            "Only the stages of a plan that standard input names, each in a line: STAGE IMAGES, as step_0 0-15, or\n"
            "finish; all options as they were planned. Answers in a line on standard output: STAGE IMAGES: done, or\n"
            "STAGE IMAGES: exit code N: message. A stage that fails does not end it. It does what is not done yet,\n"
            "and may run beside others on any machine that sees OUTPUT");
  list.Number("--chunk-images", &o->chunk_images, 1, 65534, "", "Images of the scene that make a chunk, for --plan");
  return list;
}

void AddToCommandLine(const Option& option, CLI::App* app) {
  const OptionValue value = option.get();
  if (value == OptionValue(false)) {
    app->add_flag_callback(
        option.name, [option] { option.set(true); }, option.sentence);
    return;
  }
  app->add_option_function<std::string>(
         option.name, [option](const std::string& text) { option.set(ParseOption(option, text)); },
         Concat(option.sentence, " (", DescribeValues(option), ")"))
      ->type_name("")
      ->default_str(ToYaml(value));
}

/// The options that --set takes.
std::string PipelineHelp() {
  std::string text = "\nOptions of the pipeline, for --set, with the values of the default preset:\n";
  PipelineOptions defaults = MakePreset(ReconstructOptions().preset);
  for (const Option& option : OptionsOf(&defaults)) {
    text += Concat("  ", option.name, "=", ToYaml(option.get()), "  (", DescribeValues(option), ")\n      ",
                   option.sentence, "\n");
  }
  return text;
}

void AddInputOptions(CLI::App* app, ReconstructOptions* options) {
  app->add_option("SCENE", options->scene, "Folder with images and their poses (see below)")->required();
  app->add_option("OUTPUT", options->output, "Folder for the results (see below)")->required();
  app->add_option("--image-path", options->image_path, "Folder of the images; by default SCENE/images");
  app->add_option("--images", options->images, "Use only these images, by index from 0: 0,3,7-12");
  app->add_option(
      "--masks", options->masks,
      "Folder of masks, IMAGE_NAME.png as in COLMAP: what is black (moving things, the robot, a sky) is not\n"
      "matched and gets no depth. Images without one count as a whole");
  app->add_option(
      "--prior-depth", options->prior_depth,
      "Folder of depth maps from outside (a network, another sensor), named as the images with .pfm, .dmb or .png\n"
      "(16 bit, thousandths), of any size; 0 = unknown. For what no other image confirms; scale and shift are\n"
      "fitted, or see prior_depth_metric. Images without one go without");
}

void AddMatchingOptions(CLI::App* app, ReconstructOptions* options) {
  app->option_defaults()->group("Matching");
  app->add_option("--set", options->set,
                  "NAME=VALUE: an option of the pipeline over the preset's, see below; may be given several times");
  app->add_option("--depth-min", options->depth_min,
                  "Nearest depth to search, scene units; instead of the dataset's and the landmarks'");
  app->add_option("--depth-max", options->depth_max, "Farthest depth to search");
  app->add_option("--seed", options->seed, "Of the random numbers: same seed, same bits")->capture_default_str();
  app->option_defaults()->group("Machine");
  app->add_option("--cuda-index", options->cuda_index, "Which GPUs, for example 0,1; images are shared out among them")
      ->delimiter(',')
      ->capture_default_str();
}

void AddOutputOptions(CLI::App* app, ReconstructOptions* options) {
  app->option_defaults()->group("Output");
  // Taken as one text, so that "none" can be told from names.
  app->add_option_function<std::vector<std::string>>(
         "--maps",
         [options](const std::vector<std::string>& names) {
           options->maps = names == std::vector<std::string>{"none"} ? std::vector<std::string>() : names;
         },
         "Which maps to write, for example depth,normal; none: only the cloud, in less time and a tenth of the space")
      ->delimiter(',')
      ->check(CLI::IsMember(std::vector<std::string>{"depth", "normal", "cost", "confidence", "none"}))
      ->default_str("depth,normal,cost,confidence");
  app->add_option(
      "--mesh", options->mesh,
      "Also write a mesh of all depth maps to this file, .ply or .obj; a name alone: in OUTPUT. Of a finished\n"
      "run, too");
  app->option_defaults()->group(kStageGroup);
  app->add_option("--plan", options->plan,
                  "Only plan: OUTPUT gets the plan, this file (JSON) the stages of each chunk and what they wait for");
}

void CheckDepthOption(const char* name, const std::optional<double>& value) {
  // The search is done in float.
  if (value && !(static_cast<float>(*value) > 0 && std::isfinite(static_cast<float>(*value)))) {
    throw InvalidInputError(Concat(name, " = ", *value, ": must be positive and finite"));
  }
}

void CheckMaps(const ReconstructOptions& options) {
  const std::vector<std::string>& maps = options.maps;
  for (const std::string& kind : maps) {
    if (kind == "none") throw InvalidInputError("--maps: none stands alone");
    if (std::count(maps.begin(), maps.end(), kind) > 1) {
      throw InvalidInputError(Concat("--maps: ", kind, " is given more than once"));
    }
  }
  if (options.dmb && std::count(maps.begin(), maps.end(), "depth") == 0) {
    throw InvalidInputError("--dmb: needs depth among --maps");
  }
}

void CheckMesh(const ReconstructOptions& options) {
  if (options.mesh.empty()) return;
  MeshFormatOf(options.mesh);
  const auto whole = [](const std::filesystem::path& path) { return std::filesystem::weakly_canonical(path); };
  if (whole(options.mesh).parent_path() != whole(options.output)) CheckFolderOf(options.mesh);  // OUTPUT will be made
  for (const char* kind : {"depth", "normal", "confidence"}) {
    if (std::count(options.maps.begin(), options.maps.end(), kind) > 0) continue;
    throw InvalidInputError(Concat("--mesh: needs ", kind, " among --maps"));
  }
}

void CheckStages(const ReconstructOptions& options) {
  if (options.plan.empty() && !options.stages) return;
  const char* name = options.stages ? "--stages" : "--plan";
  const auto refuse = [&](bool given, const char* other) {
    if (given) throw InvalidInputError(Concat(name, ": not with ", other));
  };
  refuse(options.stages && !options.plan.empty(), "--plan");
  refuse(options.stages && !options.images.empty(), "--images: its lines name them");
  refuse(options.online(), "--schedule online");
  refuse(options.colmap, "--colmap");
  refuse(!options.mesh.empty(), "--mesh: give it to the finished run");
  refuse(options.overwrite && options.stages, "--overwrite: give it with --plan");
  if (!options.plan.empty()) CheckFolderOf(options.plan);
}

}  // namespace

void AddReconstructOptions(CLI::App* app, ReconstructOptions* options) {
  const std::string ungrouped = app->option_defaults()->get_group();
  AddInputOptions(app, options);
  for (const Option& option : OptionsOf(options)) {
    app->option_defaults()->group(option.group.empty() ? ungrouped : option.group);
    AddToCommandLine(option, app);
  }
  AddMatchingOptions(app, options);
  AddOutputOptions(app, options);
  app->option_defaults()->group(ungrouped);
  app->footer(PipelineHelp() + kFooter);
}

void Validate(const ReconstructOptions& options) {
  ReconstructOptions checked = options;
  OptionsOf(&checked).Check();
  CheckRange("--min-source-views", options.min_source_views, 0, options.source_views);
  if (options.cuda_index.empty()) throw InvalidInputError("--cuda-index: must name at least one GPU");
  for (int index : options.cuda_index) {
    CheckRange("--cuda-index", index, 0, 1024);
    if (std::count(options.cuda_index.begin(), options.cuda_index.end(), index) > 1) {
      throw InvalidInputError(Concat("--cuda-index: GPU ", index, " is given more than once"));
    }
  }
  CheckMaps(options);
  CheckMesh(options);
  CheckStages(options);
  CheckDepthOption("--depth-min", options.depth_min);
  CheckDepthOption("--depth-max", options.depth_max);
  if (options.depth_min && options.depth_max && *options.depth_min >= *options.depth_max) {
    throw InvalidInputError(
        Concat("--depth-min = ", *options.depth_min, ": must be below --depth-max = ", *options.depth_max));
  }
  if (options.online() && options.depth_min.has_value() != options.depth_max.has_value()) {
    throw InvalidInputError("--schedule online takes --depth-min and --depth-max together or not at all");
  }
  Validate(MakePipelineOptions(options));
  if (!options.prior_depth.empty()) CheckPriorDepthIsUsed(options);
  Validate(options.pose_refinement);
  if (options.online()) Validate(MakeMapperOptions(options, {}));
}

void CheckPriorDepthIsUsed(const ReconstructOptions& options) {
  if (MakePipelineOptions(options).fill.enabled) return;
  throw InvalidInputError("--prior-depth: needs completion, which the preset does not have (--set completion=true)");
}

PipelineOptions MakePipelineOptions(const ReconstructOptions& options) {
  PipelineOptions pipeline = MakePreset(options.preset);
  pipeline.patch_match.seed = options.seed;
  for (const std::string& assignment : options.set) OptionsOf(&pipeline).Set(assignment);
  return pipeline;
}

DenseMapperOptions MakeMapperOptions(const ReconstructOptions& options, const DepthRange& dataset_range) {
  DenseMapperOptions mapper;
  mapper.pipeline = MakePipelineOptions(options);
  mapper.max_source_views = options.source_views;
  mapper.poses = options.pose_refinement;
  mapper.window_size = options.window_size;
  mapper.lookahead = options.lookahead;
  mapper.refine_again = options.refine_again;
  mapper.min_source_views = MinSourceViews(options);
  mapper.fallback_depth_range = dataset_range;
  if (options.depth_min && options.depth_max) {
    mapper.fallback_depth_range = {static_cast<float>(*options.depth_min), static_cast<float>(*options.depth_max)};
    mapper.use_landmarks = false;  // what is given by hand counts more
  }
  return mapper;
}

int MinSourceViews(const ReconstructOptions& options) {
  if (options.min_source_views > 0) return options.min_source_views;
  return options.online() ? std::min(DenseMapperOptions().min_source_views, options.source_views) : 1;
}

}  // namespace acmp
