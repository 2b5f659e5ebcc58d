#include "acmp_mapping/ros/nodelet_base.h"

#include <cstdint>
#include <exception>
#include <map>
#include <utility>

#include <ros/connection_manager.h>
#include <ros/master.h>
#include <ros/network.h>
#include <ros/this_node.h>
#include <ros/xmlrpc_manager.h>
#include <xmlrpcpp/XmlRpcClient.h>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

using XmlRpc::XmlRpcValue;

/// A new master often comes with new processes. One of this one's name goes first: its clients must not find this one.
constexpr int kChecksForOthers = 5;
constexpr int kChecksPerReading = 5;  ///< subscriptions of other nodelets in the process may come and go

/// A call of the master's API; false if it cannot be reached or refuses. Does not wait for a master.
bool Ask(const std::string& method, const std::vector<std::string>& arguments, XmlRpcValue* payload) {
  XmlRpcValue request, response;
  request[0] = ros::this_node::getName();
  for (size_t i = 0; i < arguments.size(); ++i) request[static_cast<int>(i) + 1] = arguments[i];
  return ros::master::execute(method, request, response, *payload, false);
}

/// Names in one part of the master's system state that belong to this process.
std::vector<std::string> OwnNames(XmlRpcValue part) {
  std::vector<std::string> names;
  for (int i = 0; i < part.size(); ++i) {
    XmlRpcValue nodes = part[i][1];
    bool own = false;
    for (int k = 0; k < nodes.size(); ++k) own = own || std::string(nodes[k]) == ros::this_node::getName();
    if (own) names.push_back(part[i][0]);
  }
  return names;
}

/// Tells this process who publishes a topic, as the master does when publishers come and go.
void UpdatePublishers(const std::string& topic, const XmlRpcValue& publishers) {
  const ros::XMLRPCManagerPtr manager = ros::XMLRPCManager::instance();
  std::string host;
  uint32_t port = 0;
  if (!ros::network::splitURI(manager->getServerURI(), host, port)) return;
  XmlRpc::XmlRpcClient* client = manager->getXMLRPCClient(host, static_cast<int>(port), "/");
  XmlRpcValue request, response;
  request[0] = "/master";
  request[1] = topic;
  request[2] = publishers;
  client->execute("publisherUpdate", request, response);
  manager->releaseXMLRPCClient(client);
}

}  // namespace

/// Notices that the ROS master was restarted and registers this process with the new one. roscpp registers a topic or a
/// service once: after a restart of the master nobody would find them again, and the map with them. Asks the master
/// once a second, in a thread of its own: a call may take as long as the master takes to answer.
class MasterWatch {
 public:
  /// @param report told what the user should know; runs in the thread
  MasterWatch(const ros::NodeHandle& nh, std::function<void(const std::string&)> report)
      : thread_([report](const std::string& text) { report("the ROS master's answer cannot be read: " + text); }),
        report_(std::move(report)),
        timer_(thread_.MakeTimer(nh, 1.0, [this] { Check(); })) {}

  void Start() { thread_.Start(); }
  /// Nothing is reported afterwards.
  void Stop() { thread_.Stop(); }

 private:
  void Check() {
    XmlRpcValue payload;
    if (!Ask("getPid", {}, &payload)) {
      if (reachable_) report_("the ROS master cannot be reached: what is connected goes on, and the map is kept");
      reachable_ = false;
      return;
    }
    const int pid = payload;
    const bool restarted = master_pid_ != 0 && pid != master_pid_;
    checks_of_new_ = restarted ? checks_of_new_ + 1 : 0;
    if (restarted && checks_of_new_ <= kChecksForOthers) return;
    if (restarted && !Register()) return;  // there is another of this name, or it went again: another time
    if (restarted) {
      report_(Concat("the ROS master was restarted: ", publications_.size() + subscriptions_.size(), " topics and ",
                     services_.size(), " services are registered again; the map is kept"));
    } else if (!reachable_) {
      report_("the ROS master is reached again");
    }
    reachable_ = true;
    master_pid_ = pid;
    if (!restarted && checks_++ % kChecksPerReading == 0) ReadRegistrations();
  }

  /// Whether another process has this one's name at the new master, which would end one of the two: another one that
  /// was started while this one was left over. Told once.
  bool IsReplaced() {
    XmlRpcValue uri;
    const bool replaced = Ask("lookupNode", {ros::this_node::getName()}, &uri) &&
                          std::string(uri) != ros::XMLRPCManager::instance()->getServerURI();
    if (replaced && !replaced_) {
      report_(Concat("the ROS master was restarted, and another ", ros::this_node::getName(),
                     " has registered with it (", std::string(uri),
                     "): this one stays unregistered until that one has ended"));
    }
    return replaced_ = replaced;
  }

  void ReadRegistrations() {
    XmlRpcValue state, types;
    if (!Ask("getSystemState", {}, &state) || !Ask("getTopicTypes", {}, &types)) return;
    std::map<std::string, std::string> type_of;
    for (int i = 0; i < types.size(); ++i) type_of[types[i][0]] = std::string(types[i][1]);
    publications_.clear();
    for (const std::string& topic : OwnNames(state[0])) publications_[topic] = type_of[topic];
    subscriptions_ = OwnNames(state[1]);
    services_ = OwnNames(state[2]);
  }

  bool Register() {
    const std::string uri = ros::XMLRPCManager::instance()->getServerURI();
    const std::string service_uri =
        Concat("rosrpc://", ros::network::getHost(), ":", ros::ConnectionManager::instance()->getTCPPort());
    XmlRpcValue payload;
    // Another process of the same name may come at any time, and the master would end it at the next registration.
    const auto add = [&](const char* method, const std::vector<std::string>& arguments) {
      return !IsReplaced() && Ask(method, arguments, &payload);
    };
    for (const auto& [topic, type] : publications_) {
      if (!add("registerPublisher", {topic, type, uri})) return false;
    }
    for (const std::string& service : services_) {
      if (!add("registerService", {service, service_uri, uri})) return false;
    }
    for (const std::string& topic : subscriptions_) {
      if (!add("registerSubscriber", {topic, "*", uri})) return false;  // *: whatever is published
      // An empty list would end connections to publishers that have not registered again, but still send.
      if (payload.getType() == XmlRpcValue::TypeArray && payload.size() > 0) UpdatePublishers(topic, payload);
    }
    return true;
  }

  CallbackThread thread_;  ///< first: the timer goes before it does
  std::function<void(const std::string&)> report_;
  int master_pid_ = 0;  ///< 0 = never seen
  bool reachable_ = true;
  bool replaced_ = false;
  int checks_ = 0, checks_of_new_ = 0;               ///< of a master that was seen before, and of a new one
  std::map<std::string, std::string> publications_;  ///< topic to type
  std::vector<std::string> subscriptions_;
  std::vector<std::string> services_;
  ros::WallTimer timer_;
};

NodeletBase::NodeletBase() = default;
NodeletBase::~NodeletBase() = default;

void NodeletBase::onInit() {
  try {
    Start();
    master_watch_ = std::make_unique<MasterWatch>(
        getNodeHandle(), [this](const std::string& news) { NODELET_WARN("%s", news.c_str()); });
    for (CallbackThread* thread : {&input_thread_, &service_thread_, &urgent_thread_, &status_thread_}) thread->Start();
    master_watch_->Start();
  } catch (const std::exception& error) {
    NODELET_FATAL("cannot start: %s", error.what());
    throw;
  }
}

ParameterReader NodeletBase::ReadParameters() {
  XmlRpc::XmlRpcValue values;
  getPrivateNodeHandle().getParam(getPrivateNodeHandle().getNamespace(), values);
  ParameterReader reader(values);
  reader.Allow("num_worker_threads");  // a nodelet manager of the same name
  return reader;
}

void NodeletBase::WarnOfUnknown(const ParameterReader& reader) {
  for (const std::string& warning : reader.DescribeUnknown()) NODELET_WARN("%s", warning.c_str());
}

void NodeletBase::Report(RejectedInput rejected) {
  rejected.message = Printable(rejected.message);
  if (incidents_.Record(rejected, SteadySeconds())) {
    NODELET_WARN("%s: %s", rejected.reason.c_str(), rejected.message.c_str());
  }
}

void NodeletBase::StopThreads() {
  input_thread_.Stop();
  service_thread_.Stop();
  urgent_thread_.Stop();
  status_thread_.Stop();
  if (master_watch_) master_watch_->Stop();
}

}  // namespace acmp
