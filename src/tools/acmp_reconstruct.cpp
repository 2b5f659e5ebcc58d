// acmp_reconstruct: depth, normal and cost maps and a fused point cloud of a posed image set.

#include <signal.h>
#include <tbb/global_control.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <iostream>
#include <optional>
#include <string>
#include <string_view>
#include <thread>

#include "acmp_mapping/common/stop_request.h"
#include "acmp_mapping/reconstruction/reconstruct.h"
#include "tool_main.h"

namespace {

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

constexpr char kGoesOn[] = "the same command goes on from here\n";

/// SIGINT, SIGTERM and SIGHUP request the stop. A second signal ends the process at once. Make it before any other
/// thread starts: they inherit the blocked signals.
class InterruptWatcher : public acmp::StopRequest {
 public:
  InterruptWatcher() {
    sigemptyset(&signals_);
    for (int signal : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&signals_, signal);
    pthread_sigmask(SIG_BLOCK, &signals_, &previous_signals_);
    watcher_ = std::thread([this] { Watch(); });
  }
  ~InterruptWatcher() {
    stopping_ = true;
    pthread_kill(watcher_.native_handle(), SIGINT);  // for that thread alone, which takes it and ends
    watcher_.join();
    pthread_sigmask(SIG_SETMASK, &previous_signals_, nullptr);
  }

  /// While the process waits for its next task, which nothing can interrupt, a signal ends it at once.
  void SetWaiting(bool waiting) {
    waiting_ = waiting;
    Check();  // of a signal that came before
  }

 private:
  void Watch() {
    for (int signal = 0; sigwait(&signals_, &signal) == 0 && !stopping_;) {
      const bool again = requested();
      Request();
      if (waiting_) {
        Say(std::string("acmp_reconstruct: interrupted; ") + kGoesOn);
        _exit(acmp::kExitFailed);
      }
      if (again) {
        // Files are whole or absent at any time, so stopping dead loses nothing but the step at hand.
        Say("\nstopped at once\n");
        _exit(acmp::kExitFailed);
      }
      Say("\nstopping (press Ctrl-C again to stop at once) ...\n");
    }
  }
  static void Say(std::string_view text) {
    [[maybe_unused]] const ssize_t written = write(STDERR_FILENO, text.data(), text.size());
  }

  sigset_t signals_, previous_signals_;
  std::atomic<bool> stopping_{false}, waiting_{false};
  std::thread watcher_;
};

/// The next line of standard input without its end; nothing at the end, or when it cannot be read. A stop ends the
/// process while it waits. Throws InvalidInputError for a line that no stage and images take.
std::optional<std::string> ReadLine(InterruptWatcher* interrupt) {
  constexpr size_t kMaxLine = 100000;  // characters
  std::array<char, kMaxLine + 1> line;
  interrupt->SetWaiting(true);
  std::cin.getline(line.data(), line.size());
  interrupt->SetWaiting(false);
  if (std::cin.fail() && std::cin.gcount() > 0) {
    throw acmp::InvalidInputError(acmp::Concat("--stages: a line has more than ", kMaxLine,
                                               " characters: must be STAGE IMAGES, as step_0 0-15, or finish"));
  }
  if (!std::cin) return std::nullopt;
  return line.data();
}

int RunReconstruct(const acmp::ReconstructOptions& options, InterruptWatcher* interrupt) {
  std::optional<tbb::global_control> threads;
  if (options.threads > 0) threads.emplace(tbb::global_control::max_allowed_parallelism, options.threads);
  const acmp::DeviceMaker make_devices = [&] { return acmp::MakeDevices(options, &std::cerr); };
  const bool is_terminal = isatty(STDERR_FILENO);
  const acmp::RunContext context = {make_devices, *interrupt, std::cout, std::cerr, is_terminal};
  bool all_done = true;
  try {
    interrupt->RunCancellable([&] {
      if (!options.stages) return acmp::Reconstruct(options, context);
      all_done = acmp::ReconstructStages(options, context, [&] { return ReadLine(interrupt); });
    });
    interrupt->Check();
  } catch (const acmp::Interrupted&) {
    std::cerr << "acmp_reconstruct: interrupted; " << (options.online() ? "the same command starts anew\n" : kGoesOn);
    return acmp::kExitFailed;
  }
  return all_done ? acmp::kExitDone : acmp::kExitFailed;
}

/// The options that --set takes.
std::string PipelineHelp() {
  std::string text = "\nOptions of the pipeline, for --set, with the values of the default preset:\n";
  acmp::PipelineOptions defaults = acmp::MakePreset(acmp::ReconstructOptions().preset);
  for (const acmp::Option& option : OptionsOf(&defaults)) {
    text += acmp::Concat("  ", option.name, "=", acmp::ToYaml(option.get()), "  (", acmp::DescribeValues(option),
                         ")\n      ", option.sentence, "\n");
  }
  return text;
}

void Declare(CLI::App* app, acmp::ReconstructOptions* options) {
  const std::string ungrouped = app->option_defaults()->get_group();
  app->add_option("SCENE", options->scene, "Folder with images and their poses (see below)")->required();
  app->add_option("OUTPUT", options->output, "Folder for the results (see below)")->required();
  for (const acmp::Option& option : OptionsOf(options)) AddOption(option, app);
  app->option_defaults()->group("Matching");
  app->add_option("--set", options->set,
                  "NAME=VALUE: an option of the pipeline over the preset's, see below; may be given several times");
  app->add_option("--seed", options->seed, "Of the random numbers: same seed, same bits")->capture_default_str();
  app->option_defaults()->group("Machine");
  app->add_option("--cuda-index", options->cuda_index, "Which GPUs, for example 0,1; images are shared out among them")
      ->delimiter(',')
      ->capture_default_str();
  app->option_defaults()->group("Output");
  app->add_option(
         "--maps", options->maps,
         "Which maps to write, for example depth,normal; none: only the cloud, in less time and a tenth of the "
         "space")
      ->delimiter(',')
      ->check(CLI::IsMember(std::vector<std::string>{"depth", "normal", "cost", "confidence", "none"}))
      ->default_str("depth,normal,cost,confidence");
  app->option_defaults()->group(ungrouped);
  app->footer(PipelineHelp() + kFooter);
}

int Run(int argc, char** argv) {
  signal(SIGXFSZ, SIG_IGN);  // a file that grows over its limit is then an error like a full disk
  InterruptWatcher interrupt;
  acmp::ReconstructOptions options;
  CLI::App app(
      "Computes depth, normal, cost and confidence maps of images with known poses by planar prior assisted\n"
      "PatchMatch multi-view stereo (ACMP), and fuses them into one point cloud.",
      "acmp_reconstruct");
  Declare(&app, &options);
  return acmp::RunTool(app, argc, argv, [&] {
    if (options.maps == std::vector<std::string>{"none"}) options.maps.clear();
    if (!options.mesh.empty() && !options.mesh.has_parent_path()) options.mesh = options.output / options.mesh;
    return RunReconstruct(options, &interrupt);
  });
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return Run(argc, argv);
  } catch (const std::exception& error) {  // before the command line was declared: no memory, no thread
    std::cerr << "acmp_reconstruct: " << error.what() << '\n';
  } catch (...) {
  }
  return acmp::kExitFailed;
}
