// A nodelet in a process of its own: the mains of dense_mapper_node and map_server_node. ACMP_NODE is the name,
// ACMP_NODELET the nodelet.

#include <sys/mman.h>

#include <atomic>
#include <csignal>
#include <cstdlib>
#include <exception>
#include <future>
#include <iostream>
#include <stdexcept>
#include <string_view>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include <nodelet/loader.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>

namespace acmp {
namespace {

std::atomic<bool> g_stop{false};

void HandleSignal(int /*signal*/) { g_stop = true; }

/// Throws where a node could not start. Before ROS, as roscpp, nodelet and the logger that OpenVDB brings along abort
/// or wait for ever where only some of their threads can be started: so more than they and the nodelets start are tried
/// here, with room for libraries beside their stacks.
void CheckThreadsAndMemory() {
  constexpr size_t kBytes = size_t{512} << 20;
  const unsigned threads = 24 + 2 * std::thread::hardware_concurrency();
  void* const space = mmap(nullptr, kBytes, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  std::promise<void> end;
  const std::shared_future<void> ended = end.get_future().share();
  std::vector<std::thread> started;
  try {
    while (started.size() < threads) started.emplace_back([ended] { ended.wait(); });
  } catch (const std::system_error&) {  // told below
  }
  end.set_value();
  for (std::thread& thread : started) thread.join();
  if (space != MAP_FAILED) munmap(space, kBytes);
  if (space != MAP_FAILED && started.size() == threads) return;
  throw std::runtime_error(
      "a node starts with at least 512 MiB of address space (ulimit -v) and " + std::to_string(threads) +
      " threads (24, and two for each processor; ulimit -u, pids of a cgroup); here " +
      (space == MAP_FAILED ? "the space" : "thread " + std::to_string(started.size() + 1)) + " is missing");
}

/// roscpp waits for a master without heeding signals. False: a signal came first.
bool WaitForMaster() {
  bool told = false;
  while (!ros::master::check()) {
    if (g_stop) return false;
    if (!std::exchange(told, true)) {
      std::cerr << "waiting for the ROS master at " << ros::master::getURI() << " (ROS_MASTER_URI)" << std::endl;
    }
    ros::WallDuration(0.1).sleep();
  }
  return true;
}

/// Runs until SIGINT or SIGTERM. Returns the exit code.
int RunStandalone(int argc, char** argv, const char* default_name, const char* nodelet_type) {
  for (int i = 1; i < argc; ++i) {
    const std::string_view argument = argv[i];
    if (argument == "--version") {
      std::cout << default_name << "_node " << ACMP_VERSION << std::endl;
      return std::cout ? 0 : 1;
    }
    if (argument != "--help" && argument != "-h") continue;
    std::cout
        << "The nodelet " << nodelet_type << " as a node of its own: " << default_name
        << "_node [TOPIC:=TOPIC ...] [_PARAMETER:=VALUE ...]\n"
           "It needs a ROS master and all parameters of its configuration, as launch/dense_mapper.launch loads them\n"
           "with standalone:=true. Topics and services: README.md; parameters: docs/parameters.md."
        << std::endl;
    return std::cout ? 0 : 1;
  }
  CheckThreadsAndMemory();
  ros::init(argc, argv, default_name, ros::init_options::NoSigintHandler);
  // roscpp handles SIGINT only; roslaunch and systemd end programs with SIGTERM.
  std::signal(SIGINT, HandleSignal);
  std::signal(SIGTERM, HandleSignal);
  if (!WaitForMaster()) return 0;
  ros::NodeHandle keep_ros_alive;
  {
    // The loader's destructor ends the nodelet and joins its threads while ROS is still up.
    nodelet::Loader loader(false);
    if (!loader.load(ros::this_node::getName(), nodelet_type, ros::names::getRemappings(),
                     nodelet::V_string(argv + 1, argv + argc))) {
      return 1;
    }
    while (ros::ok() && !g_stop) ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.1));
  }
  ros::shutdown();
  return 0;
}

}  // namespace
}  // namespace acmp

int main(int argc, char** argv) {
  try {
    return acmp::RunStandalone(argc, argv, ACMP_NODE, "acmp_mapping/" ACMP_NODELET);
  } catch (const std::exception& error) {  // of roscpp: without memory it can start no thread
    std::cerr << ACMP_NODE "_node: " << error.what()
              << "; where threads or memory are short, they may be limited (ulimit -u, -v)" << std::endl;
    std::_Exit(1);  // roscpp's own destructors abort when it is half started
  }
}
