#include "acmp_mapping/reconstruction/reconstruct_options.h"

#include <algorithm>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/dataset/scene.h"

namespace acmp {
namespace {

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

/// All options of the command line that are one value, by their names there, with their bounds.
OptionList OptionsOf(ReconstructOptions* o) {
  OptionList list;
  const auto path = [&list](const char* name, std::filesystem::path* field, const char* sentence) {
    list.Add(
        name, sentence, [field]() -> OptionValue { return field->string(); },
        [field](const OptionValue& value) { *field = std::get<std::string>(value); });
  };
  // Another table's "window_size" is --window-size.
  const auto append = [&list](Option option, const char* before) {
    std::replace(option.name.begin(), option.name.end(), '_', '-');
    option.name.insert(0, "--");
    option.sentence.insert(0, before);
    option.group = (list.end() - 1)->group;
    list.Append(option);
  };
  path("--image-path", &o->image_path, "Folder of the images; by default SCENE/images");
  list.Text("--images", &o->images, "Use only these images, by index from 0: 0,3,7-12");
  path("--masks", &o->masks,
       "Folder of masks, IMAGE_NAME.png as in COLMAP: what is black (moving things, the robot, a sky) is not\n"
       "matched and gets no depth. Images without one count as a whole");
  path("--prior-depth", &o->prior_depth,
       "Folder of depth maps from outside (a network, another sensor), named as the images with .pfm, .dmb or .png\n"
       "(16 bit, thousandths), of any size; 0 = unknown. For what no other image confirms; scale and shift are\n"
       "fitted, or see prior_depth_metric. Images without one go without");
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
  append(OptionsOf(&o->pose_refinement).Find("refine_poses"), "");
  list.Number("--depth-min", &o->depth_min, 0, 1e9, "",
              "Nearest depth to search, scene units; 0: as the dataset or the landmarks tell");
  list.Number("--depth-max", &o->depth_max, 0, 1e9, "", "Farthest depth to search; 0: as they tell");

  list.Group("Schedule");
  list.Text("--schedule", &o->schedule,
            "offline: all images know each other; online: images come one by one in the order of their index and are\n"
            "matched within a sliding window, as in the ROS nodelet (pair.txt is not used then)")
      .choices = {"offline", "online"};
  const OptionList of_mapper = OptionsOf(&o->mapper);
  for (const char* name : {"window_size", "lookahead", "refine_again"}) append(of_mapper.Find(name), "Online: ");

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
  path("--mesh", &o->mesh,
       "Also write a mesh of all depth maps to this file, .ply or .obj; a name alone: in OUTPUT. Of a finished\n"
       "run, too");
  list.Flag("--dmb", &o->dmb, "Also write depth as .dmb (Gipuma, ACMP)");
  list.Flag("--colmap", &o->colmap,
            "Also write OUTPUT/colmap, COLMAP's dense workspace, for colmap stereo_fusion, OpenMVS, trainers of splats "
            "and\nothers. Its depth maps leave out pixels that no view confirms, those of cost 2");
  list.Flag("--no-pictures", &o->no_pictures, "No colour pictures of the maps");
  list.Flag("--overwrite", &o->overwrite, "Start afresh: remove what an earlier run left in OUTPUT");
  list.Flag("--keep-work", &o->keep_work, "Keep OUTPUT/work at the end");
  list.Flag("--quiet", &o->quiet, "No progress; only warnings and errors");

  list.Group("Stages, for several machines (scripts/acmp_cluster.py; docs/offline.md)");
  list.Flag("--stages", &o->stages,
            "Only the stages of a plan that standard input names, each in a line: STAGE IMAGES, as step_0 0-15, or\n"
            "finish; all options as they were planned. Answers in a line on standard output: STAGE IMAGES: done, or\n"
            "STAGE IMAGES: exit code N: message. A stage that fails does not end it. It does what is not done yet,\n"
            "and may run beside others on any machine that sees OUTPUT");
  path("--plan", &o->plan,
       "Only plan: OUTPUT gets the plan, this file (JSON) the stages of each chunk and what they wait for");
  list.Number("--chunk-images", &o->chunk_images, 1, 65534, "", "Images of the scene that make a chunk, for --plan");
  return list;
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
  const bool has_min = options.depth_min > 0, has_max = options.depth_max > 0;
  if (has_min && has_max && options.depth_min >= options.depth_max) {
    throw InvalidInputError(
        Concat("--depth-min = ", options.depth_min, ": must be below --depth-max = ", options.depth_max));
  }
  if (options.online() && has_min != has_max) {
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
  DenseMapperOptions mapper = options.mapper;
  mapper.pipeline = MakePipelineOptions(options);
  mapper.max_source_views = options.source_views;
  mapper.poses = options.pose_refinement;
  mapper.min_source_views = MinSourceViews(options);
  mapper.fallback_depth_range = dataset_range;
  if (options.depth_min > 0 && options.depth_max > 0) {
    mapper.fallback_depth_range = {static_cast<float>(options.depth_min), static_cast<float>(options.depth_max)};
    mapper.use_landmarks = false;  // what is given by hand counts more
  }
  return mapper;
}

int MinSourceViews(const ReconstructOptions& options) {
  if (options.min_source_views > 0) return options.min_source_views;
  return options.online() ? std::min(DenseMapperOptions().min_source_views, options.source_views) : 1;
}

}  // namespace acmp
