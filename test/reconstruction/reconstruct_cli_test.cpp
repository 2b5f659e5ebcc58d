#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <cstring>
#include <iomanip>
#include <sstream>
#include <thread>

#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/mesh/distance_volume.h"
#include "reconstruction/scene_fixture.h"
#include "support/error_text.h"

// The program itself, with the real matcher on the CPU: exit codes, signals, full disks.
namespace acmp {
namespace {

using ::testing::MatchesRegex;

class ReconstructCliTest : public ReconstructFixture {
 protected:
  struct Outcome {
    int exit_code = -1;
    std::string text;  ///< both streams
  };

  Outcome RunShell(const std::string& command) const {
    const auto log = folder() / "log.txt";
    const int status = std::system(("(" + command + ") > " + log.string() + " 2>&1").c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, ReadText(log)};
  }
  Outcome RunTool(const std::string& arguments) const {
    return RunShell(std::string(ACMP_RECONSTRUCT) + " " + arguments);
  }
  std::string Usual(const std::string& out = "out") const {
    return scene().string() + " " + output(out).string() + " --device cpu --source-views 3";
  }

  /// Starts the tool, waits for a file to appear, sends a signal, and returns the exit status.
  int SignalWhen(const std::filesystem::path& file, int signal) const {
    const pid_t child = fork();
    if (child == 0) {
      const auto log = (folder() / "log.txt").string();
      if (!std::freopen(log.c_str(), "w", stdout) || dup2(STDOUT_FILENO, STDERR_FILENO) < 0) _exit(99);
      const std::string scene_name = scene().string();
      const std::string output_name = output().string();
      execl(ACMP_RECONSTRUCT, ACMP_RECONSTRUCT, scene_name.c_str(), output_name.c_str(), "--device", "cpu",
            "--source-views", "3", "--threads", "2", nullptr);
      _exit(98);
    }
    while (!std::filesystem::exists(file) && waitpid(child, nullptr, WNOHANG) == 0) {
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    kill(child, signal);
    int status = 0;
    waitpid(child, &status, 0);
    return status;
  }
};

TEST_F(ReconstructCliTest, FindsThePlaneWithEitherSchedule) {
  WriteScene(4, 64, 48);
  for (const char* schedule : {"offline", "online"}) {
    const Outcome outcome = RunTool(Usual(schedule) + " --schedule " + schedule);
    ASSERT_EQ(outcome.exit_code, 0) << outcome.text;
    EXPECT_THAT(outcome.text, HasSubstr("points in fused.ply"));
    const DepthMap depth = ReadDepth(output(schedule) / "depth/000001.png");
    int close = 0;
    for (float z : depth) close += std::abs(z - kPlaneDepth) < 0.02 * kPlaneDepth;
    // Border pixels that no neighbour sees cannot be matched: a step shifts the view by 1/16 of the width.
    EXPECT_GT(close, 0.85 * depth.size()) << schedule;
    EXPECT_GT(ReadPly(output(schedule) / "fused.ply").vertices.size(), 64u * 48u / 2) << schedule;
  }
}

TEST_F(ReconstructCliTest, MeshIsThePlaneAlsoOfAFinishedRun) {
  WriteScene(4, 64, 48);
  const std::string file = (output() / "mesh.ply").string();  // of a folder that is made by the run
  const auto rejects = [&](const std::string& arguments, const std::string& text) {
    const Outcome outcome = RunTool(Usual() + " " + arguments);
    EXPECT_EQ(outcome.exit_code, 2) << outcome.text;
    EXPECT_THAT(outcome.text, HasSubstr(text));
    EXPECT_FALSE(std::filesystem::exists(output())) << "refused before matching begins";
  };
  rejects("--mesh mesh.stl", "must end with .ply or .obj");
  rejects("--mesh " + (folder() / "missing/mesh.ply").string(), "there is no folder");
  rejects("--maps none --mesh " + file, "--mesh: needs depth among --maps");
  const Outcome first = RunTool(Usual() + " --mesh " + file);
  ASSERT_EQ(first.exit_code, 0) << first.text;
  EXPECT_THAT(first.text, HasAll("mesh.ply: ", " triangles, voxels of "));
  const TriangleMesh mesh = ReadPly(file);
  ASSERT_GT(mesh.triangles.size(), 500u);
  size_t close = 0;
  for (const SurfacePoint& vertex : mesh.vertices) {
    close += std::abs(vertex.position.z - kPlaneDepth) < 0.02 * kPlaneDepth;
    EXPECT_LT(vertex.normal.z, 0.5f) << "towards the cameras";
  }
  EXPECT_GT(static_cast<double>(close), 0.9 * static_cast<double>(mesh.vertices.size()));
  const std::string bytes = ReadText(file);
  std::filesystem::remove(file);
  const Outcome again = RunTool(Usual() + " --mesh " + file);
  EXPECT_THAT(again.text, HasAll("already complete", "triangles"));
  EXPECT_TRUE(ReadText(file) == bytes);
  const Outcome little = RunTool(Usual() + " --memory-limit-gb 0.001 --mesh-voxel-size 0.01 --mesh " + file);
  EXPECT_EQ(little.exit_code, 2) << little.text;
  EXPECT_THAT(little.text, HasAll("more than the", "the voxel size must be larger"));
  const Outcome full = RunShell("ulimit -f 8; " + std::string(ACMP_RECONSTRUCT) + " " + Usual() + " --mesh " + file);
  EXPECT_EQ(full.exit_code, 1) << full.text;
  EXPECT_THAT(full.text, HasSubstr("mesh.ply"));
  EXPECT_TRUE(ReadText(file) == bytes) << "the old file is whole";
}

TEST_F(ReconstructCliTest, ColmapMapsLeaveOutWhatWasGuessed) {
  WriteScene(4, 64, 48);
  ASSERT_EQ(RunTool(Usual() + " --colmap").exit_code, 0);
  const DepthMap depth = ReadPfm(output() / "depth/000000.pfm");
  const CostMap cost = ReadPfm(output() / "cost/000000.pfm");
  const std::string content = ReadText(output() / "colmap/stereo/depth_maps/00000000.png.geometric.bin");
  ASSERT_EQ(content.size(), 8 + depth.size() * sizeof(float));  // "64&48&1&"
  int guessed = 0;
  for (size_t i = 0; i < depth.size(); ++i) {
    float written = 0;
    std::memcpy(&written, &content[8 + i * sizeof(float)], sizeof(written));
    guessed += cost.data()[i] >= 2 && depth.data()[i] > 0;
    ASSERT_EQ(written, cost.data()[i] < 2 ? depth.data()[i] : 0);
  }
  EXPECT_GT(guessed, 0) << "nothing was guessed: the test shows nothing";
  EXPECT_LT(guessed, 0.2 * depth.size());
}

TEST_F(ReconstructCliTest, ExitCodesOfWrongUse) {
  EXPECT_EQ(RunTool("--help").exit_code, 0);
  EXPECT_THAT(RunTool("--help").text, HasSubstr("SCENE is a folder of images with known camera poses"));
  for (const float cost :
       {kWorstCost, kUnverifiedCost, kUnsupportedCost}) {  // all that cost/*.pfm may have beside costs
    std::ostringstream value;
    value << std::setprecision(8) << cost << " =";
    EXPECT_THAT(RunTool("--help").text, HasSubstr(value.str()));
  }
  EXPECT_EQ(RunTool("--version").exit_code, 0);
  EXPECT_EQ(RunTool("").exit_code, 2);
  EXPECT_EQ(RunTool(folder().string()).exit_code, 2);
  EXPECT_THAT(RunTool("").text, HasSubstr("SCENE is required"));
  EXPECT_EQ(RunTool("--nonsense").exit_code, 2);
  EXPECT_THAT(RunTool("--nonsense").text, HasSubstr("not expected: --nonsense"));
  const Outcome missing = RunTool((folder() / "nowhere").string() + " " + output().string() + " --device cpu");
  EXPECT_EQ(missing.exit_code, 2);
  EXPECT_THAT(missing.text, HasSubstr("nowhere"));
  WriteScene(3, 24, 18);
  for (const char* bad : {"--device tpu", "--source-views many", "--maps color", "--depth-min 5 --depth-max 1",
                          "--source-views 0", "--images 9", "--no-such-option"}) {
    const Outcome outcome = RunTool(Usual() + " " + bad);
    EXPECT_EQ(outcome.exit_code, 2) << bad << ": " << outcome.text;
    EXPECT_NE(outcome.text, "") << bad;
  }
  EXPECT_FALSE(std::filesystem::exists(output()));
}

TEST_F(ReconstructCliTest, NoPointsAreAFailure) {
  WriteScene(4, 64, 48);
  for (int attempt = 0; attempt < 2; ++attempt) {  // the second finds a finished run
    const Outcome outcome = RunTool(Usual() + " --max-image-size 8 --set min_confidence=1");
    EXPECT_EQ(outcome.exit_code, 1) << outcome.text;
    EXPECT_THAT(outcome.text, HasSubstr("none of the 192 pixels became a point: poses, cameras"));
  }
  EXPECT_TRUE(std::filesystem::exists(output() / "depth/000001.pfm")) << "to see what went wrong";
}

TEST_F(ReconstructCliTest, TwoImagesMakePointsButNotOfThePapers) {
  WriteScene(2, 64, 48);
  EXPECT_THAT(RunTool(Usual()).text, AllOf(HasSubstr("points in fused.ply"), Not(HasSubstr(" 0 points"))));
  const Outcome outcome = RunTool(Usual() + " --overwrite --preset acmp");
  EXPECT_EQ(outcome.exit_code, 0) << outcome.text;
  EXPECT_THAT(outcome.text, HasSubstr("2 source views must agree in this preset, and 2 images have maps"));
}

TEST_F(ReconstructCliTest, FullDiskFailsAndTheRunCanGoOn) {
  WriteScene(4, 64, 48);
  ASSERT_EQ(RunTool(Usual("whole")).exit_code, 0);
  for (const int blocks :
       {20, 60, 150}) {  // of 1024 bytes per file: work files (60 KiB), maps and the cloud differ in size
    std::filesystem::remove_all(output());
    const Outcome outcome = RunShell("ulimit -f " + std::to_string(blocks) + "; " + ACMP_RECONSTRUCT + " " + Usual());
    if (outcome.exit_code == 0) {
      EXPECT_GT(blocks, 60) << "nothing was larger than the limit";
      continue;
    }
    EXPECT_EQ(outcome.exit_code, 1) << outcome.text;
    EXPECT_THAT(outcome.text, AnyOf(HasSubstr("File too large"), HasSubstr("No space left")));
    EXPECT_EQ(RunTool(Usual()).exit_code, 0);
    ExpectSameContents(output("whole"), output());
  }
}

TEST_F(ReconstructCliTest, AStoppedOrKilledRunGoesOn) {
  WriteScene(5, 64, 48);
  ASSERT_EQ(RunTool(Usual("whole")).exit_code, 0);
  for (const auto& [signal, file] : {std::make_pair(SIGINT, "step_0/000001.bin"),
                                     {SIGKILL, "step_0/000001.bin"},
                                     {SIGKILL, "step_1/000002.bin"},
                                     {SIGKILL, "final/000002.bin"}}) {
    std::filesystem::remove_all(output());
    const int status = SignalWhen(output() / "work" / file, signal);
    if (signal == SIGINT && WEXITSTATUS(status) != 0) {  // else the run ended before the signal came
      EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 1) << "the signal must be handled";
      EXPECT_THAT(ReadText(folder() / "log.txt"), HasSubstr("interrupted; the same command goes on from here"));
    }
    const Outcome second = RunTool(Usual());
    EXPECT_EQ(second.exit_code, 0) << second.text;
    ExpectSameContents(output("whole"), output());
  }
}

TEST_F(ReconstructCliTest, DoesStagesThatStandardInputNames) {
  WriteScene(4, 64, 48);
  ASSERT_EQ(RunTool(Usual() + " --plan " + (folder() / "plan.json").string()).exit_code, 0);
  const std::string stages = std::string(ACMP_RECONSTRUCT) + " " + Usual() + " --quiet --stages";
  const Outcome outcome = RunShell("printf 'step_0 0-1\\nstep_9 0\\nstep_0 2-3' | " + stages);
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_THAT(outcome.text, MatchesRegex("step_0 0-1: done\nstep_9 0: exit code 2: stage step_9: must be one of "
                                         "[^\n]*\nstep_0 2-3: done\n"));
  const Outcome again = RunShell("echo step_0 0-3 | " + stages);
  EXPECT_EQ(again.exit_code, 0);
  EXPECT_EQ(again.text, "step_0 0-3: done\n");
  EXPECT_EQ(RunTool(Usual() + " --stages --images 0 < /dev/null").exit_code, 2);
  const Outcome endless = RunShell("yes x | tr -d '\\n' | " + stages);
  EXPECT_EQ(endless.exit_code, 2);
  EXPECT_THAT(endless.text, HasSubstr("a line has more than 100000 characters"));
  const Outcome stopped = RunShell("cd " + folder().string() + "; mkfifo lines; " + stages +
                                   " <> lines > answers & echo step_0 0-3 > lines; "
                                   "for i in $(seq 600); do grep -q done answers && break; sleep 0.05; done; "
                                   "kill -TERM $!; wait $!");
  EXPECT_EQ(stopped.exit_code, 1) << "while it waits for a line";
  EXPECT_THAT(stopped.text, HasSubstr("interrupted; the same command goes on from here"));
}

}  // namespace
}  // namespace acmp
